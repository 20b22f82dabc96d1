"""The measurement update of one epoch: gate, then an iterated extended Kalman update on the factors.

The update is relinearised (Gauss-Newton) while the correction is large enough for the bending of h to show: image error
f (dx / d)^2 above a tenth of the spot noise, d the distance to the nearest beacon. In steady state once is enough.
"""

import math

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, held, select
from relnav.dynamics.error_state import MOTION
from relnav.estimation.factored import innovation_variance
from relnav.estimation.rows import copy_track, gate_groups, give_back, sweep
from relnav.navigation.memory import Memory
from relnav.navigation.observation.attitude_check import attitude_is_credible
from relnav.navigation.observation.beacon_considered import (
    add_considered_noise,
    consider,
    look_at_errors,
    observed,
    refer_turns,
)
from relnav.navigation.observation.beacon_geometry import locate, uses_coordinates
from relnav.navigation.observation.beacon_monitors import gather_rows, show_nothing
from relnav.navigation.observation.beacon_rows import observe, observe_again
from relnav.navigation.status import LOST, PARTIAL, PREDICTED, REJECTED, UPDATED
from relnav.sensors.measurement import MISALIGNED

MAX_ITERATIONS = 10
LONE_GATE_SHARE = 0.01


@kernel
def bends(m: Memory, at: Vector, x: Vector) -> bool:
    """Whether the step between two states is long enough for a second linearisation to matter."""
    nearest2, moved2, offset, dock = math.inf, 0.0, m.sensor["offset"], m.kept["dock"]
    for i in range(m.beacons.shape[0]):
        position = m.beacons[i]["position"]
        d2 = 0.0
        for j in range(3):
            d2 += (position[j] - at[j] - offset[j] - dock[j, 3]) ** 2
        nearest2 = min(nearest2, d2)
    for j in range(3):
        moved2 += (x[j] - at[j]) ** 2
    return bool(m.sensor["focal_length"] * moved2 > 0.1 * m.sensor["spot_sigma"] * nearest2)


@kernel
def _lone_beacon_is_telling(m: Memory, ld: Matrix) -> bool:
    """Whether a single beacon, if it is single, is predicted so well that a glint would hardly pass for it.

    Its gate, an ellipse of area pi g sqrt(det S), must cover less than 1 % of the detector; after a long coast it does
    not, and the filter waits for two beacons.
    """
    lone, beacons = 0, 0
    for i in range(m.groups.shape[0]):
        variance = m.groups[i]["variance"]
        used = (variance[0] > 0.0) | (variance[1] > 0.0)
        lone, beacons = select(used, i, lone), select(used, beacons + 1, beacons)
    if beacons != 1:
        return True
    hx, hy, sigma = m.groups[lone]["gradient"][0], m.groups[lone]["gradient"][1], m.beacons[lone]["spot_sigma"]
    xx = innovation_variance(ld, hx, hx) + sigma[0] * sigma[0]
    yy = innovation_variance(ld, hy, hy) + sigma[1] * sigma[1]
    xy = innovation_variance(ld, hx, hy)
    area = math.pi * m.gate[1] * math.sqrt(max(0.0, xx * yy - xy * xy))
    half = m.sensor["half_width"]
    return bool(area < LONE_GATE_SHARE * 4.0 * half[0] * half[1])


@kernel
def clear_results(result: Record, innovations: Vector) -> None:
    """No NIS, no innovations, nothing used."""
    result["nis"], result["dof"], result["iterations"], result["used"] = math.nan, 0, 0, 0
    for k in range(innovations.shape[0]):
        innovations[k] = math.nan


@kernel
def _keep_innovations(m: Memory) -> None:
    if uses_coordinates(m.sensor):
        for i in range(m.groups.shape[0]):
            variance, residual = m.groups[i]["variance"], m.groups[i]["residual"]
            for k in range(2):
                m.innovations[2 * i + k] = select(variance[k] > 0.0, residual[k], m.innovations[2 * i + k])
    else:
        variance, innovation = m.groups[0]["variance"], m.groups[0]["innovation"]
        for k in range(3):
            m.innovations[k] = select(variance[k] > 0.0, innovation[k], m.innovations[k])


@kernel
def correct(m: Memory, track: Record, sensitivities: Matrix, spots: Matrix, watched: bool) -> int:
    """Update a track, state and factors, and its sensitivities (m, 6), with one image (n, 2) m.

    watched: the monitors are handed its rows. Returns an epoch status, details in the result.
    """
    x, result, work = track["state"], m.result, m.work
    clear_results(result, m.innovations)
    if watched:
        show_nothing(m)
    if not locate(m, track):
        return LOST
    seen, usable, reason = observe(m, x, spots)
    result["reason"] = reason
    tells = usable > 0
    if not anywhere(tells):
        return select(seen == 0, PREDICTED, REJECTED)
    tells = held(tells)
    coordinates = uses_coordinates(m.sensor)
    if coordinates:
        add_considered_noise(m, x, sensitivities, spots)
    image = observed(m)
    if coordinates and not _lone_beacon_is_telling(m, track["ld"]):
        return PREDICTED
    _keep_innovations(m)
    nis, dof = sweep(track, x, image, work)
    result["nis"], result["dof"] = select(tells, nis, math.nan), dof
    if watched:
        gather_rows(m, track, spots, tells)
    passed = seen
    # a part's NIS is at most the whole's, and no whole beacon has fewer than two degrees of freedom
    if not coordinates or anywhere((usable < 2 * seen) | (not nis <= m.gate[1])):
        passed = gate_groups(track, image, m.gate, work, nis, dof)
    taken = tells & (passed > 0)
    if not coordinates and anywhere(taken):
        turned = not attitude_is_credible(m, work, sensitivities, spots, held(taken))
        result["reason"], taken = select(turned, MISALIGNED, reason), taken & (not turned)
    not_taken = select(seen == 0, PREDICTED, REJECTED)
    if not anywhere(taken):
        return not_taken
    taken = held(taken)
    give_back(track, work, not taken)
    at, carried = m.fixed["at"], work["state"]
    for j in range(MOTION):
        at[j] = x[j]
    iterations = 1
    while iterations < MAX_ITERATIONS:
        if not bends(m, at, carried):
            break
        for j in range(MOTION):
            at[j] = carried[j]
        if not observe_again(m, at, spots):
            break
        sweep(track, at, image, work)
        iterations += 1
    result["iterations"], result["used"] = select(taken, iterations, 0), select(taken, passed, 0)
    if sensitivities.shape[0] > 0:
        if coordinates and iterations > 1:
            refer_turns(m, x, at, sensitivities)
            look_at_errors(m, at, sensitivities, spots)
        consider(m, work["ld"], at, image, sensitivities, spots)
        refer_turns(m, at, carried, sensitivities)
    copy_track(work, track)
    return select(taken, select(passed == seen, UPDATED, PARTIAL), not_taken)
