"""Errors that last are considered: not estimated, but carried in what is reported (Schmidt 1966).

A calibration leaves an error in every spot coordinate that stays while the spot hardly moves; focal length, mountings
and beacons are known to a tolerance. A filter that takes such an error for noise averages it, one that ignores it does
not know of it, and both become overconfident. Here the filter's own factors L D L^T remain those of what is new in
every image; beside them runs S (6, m), what one sigma of each error does to the estimate. It is linear in the
measurements, so S is carried as the estimate itself is:

    S = dx/dz E                         at a start from one image z, E what the errors do to it
    S <- Phi S                          from epoch to epoch
    S <- S + P+ H^T R^-1 (E - H S)      at an update, P+ after it
    S <- S - sigma a x dx               of turns of chaser and camera, where an update moves what `spots` find by dx
    S <- S + C (S later - Phi S)        smoothed (`smoothing.py`)

and P = L D L^T + S S^T is reported. For gate and gain R holds them too, as if they were new in every image: what is a
coordinate's own (its spot's, its beacon's place) whole, so that a bad one counts for less; what all share as far as
the state cannot take it up, (E - H S)^2. R of a fix, which the state takes up whole, holds the spots' lasting errors.

What lasts in the spots is a smooth field over the detector: neighbouring spots share it, and a spot that travels
leaves its error behind. It is carried as independent errors on 4 x 4 nodes over the calibrated box, for x and for y;
between nodes a spot's error is their mean, weighted bilinearly and scaled to the spot's own sigma. So spots share much
of it at half a spacing, a third of the half width, and little at a whole one, as they do of what calibrations from 225
points leave: correlations of 0.5 to 0.75 and of 0.05 to 0.45 by how fine the detector's figure is (a test).

Rows of `sensitivities` (m, 6), columns of S, are a stretch of: the nodes of x, of y; turns of the chaser about the
camera's axes, by which the stated attitude is wrong; the focal length; turns of the camera about its axes; turns of the
beacons about the docking axes, at the port; every beacon along the docking axes. Without a calibration or tolerances
only the attitude's are left.

The noise of the attitude that comes with an image turns all its spots together: R then is a whole matrix.
What it does to a fix is in `beacon_arm.py`.
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, held, select
from relnav.dynamics.error_state import MOTION, VELOCITY
from relnav.estimation.considered import add_covariance_times, follow_turn, subtract_taken, update_sensitivities
from relnav.estimation.factored import add_rank_one
from relnav.estimation.rows import Observed
from relnav.geometry.spherical import position_from_angles_jacobian
from relnav.navigation.blocks import ATTITUDE_ERRORS, FIELD_ERRORS, TOLERANCES_SHARED
from relnav.navigation.memory import Memory
from relnav.navigation.observation.beacon_geometry import uses_coordinates
from relnav.navigation.observation.beacon_lasting_errors import (
    error_of_numbers,
    errors_of_coordinates,
    errors_of_position,
    place_in_field,
    position_by_beacon,
)


@kernel
def shared_errors(m: Memory) -> tuple[int, int]:
    """Rows of the errors that all beacons share: from the first to before the last."""
    count, first = m.by_error.shape[1], FIELD_ERRORS - m.fixed["first_error"]
    return min(count, first), min(count, first + ATTITUDE_ERRORS + TOLERANCES_SHARED)


@kernel
def look_at_errors(m: Memory, x: Vector, sensitivities: Matrix, spots: Matrix) -> None:
    """Write `turns` and `by_error` of coordinates linearised at x, less what the estimate has of errors that all share.

    sensitivities (m, 6) as predicted.
    """
    errors_of_coordinates(m, x, spots)
    first, last = shared_errors(m)
    subtract_taken(m.groups, m.by_error, sensitivities, first, last)


@kernel
def add_considered_noise(m: Memory, x: Vector, sensitivities: Matrix, spots: Matrix) -> None:
    """Add considered errors, and the attitude's noise, to the variance of every coordinate in use.

    sensitivities (m, 6) as predicted; rows linearised at x.
    """
    count, noise = sensitivities.shape[0], m.sensor["attitude_noise"]
    if count == 0 and noise == 0.0:
        return
    look_at_errors(m, x, sensitivities, spots)
    for i in range(2 * m.groups.shape[0]):
        variance, turn, row = m.groups[i // 2]["variance"], m.turns[i], m.by_error[i]
        used = variance[i % 2] > 0.0
        if anywhere(used):
            total = noise * noise * (turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
            for j in range(count):
                total += row[j] * row[j]
            variance[i % 2] = select(held(used), variance[i % 2] + total, variance[i % 2])


@kernel
def observed(m: Memory) -> Observed:
    """The groups in use, with the covariance of their noise where the attitude's is in it."""
    coordinates, noise = uses_coordinates(m.sensor), m.sensor["attitude_noise"]
    if not coordinates or noise == 0.0:
        return Observed(m.groups if coordinates else m.groups[0:1], m.nothing, m.nothing, m.groups[0:0])
    for i in range(m.noise.shape[0]):
        a = m.turns[i]
        for k in range(i):
            b = m.turns[k]
            m.noise[i, k] = noise * noise * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
            m.noise[k, i] = m.noise[i, k]
        m.noise[i, i] = m.groups[i // 2]["variance"][i % 2]
    return Observed(m.groups, m.noise, m.factor, m.independent)


@kernel
def consider(m: Memory, ld: Matrix, at: Vector, image: Observed, sensitivities: Matrix, spots: Matrix) -> None:
    """Take an image into sensitivities (m, 6), m > 0, by the rows in use, linearised at `at`; ld: after it.

    Of coordinates `look_at_errors` was there before.
    """
    count, first, last = sensitivities.shape[0], 0, 0
    if uses_coordinates(m.sensor):
        first, last = shared_errors(m)
    else:
        errors_of_position(m, at, spots)
    subtract_taken(image.groups, m.by_error, sensitivities, 0, first)
    subtract_taken(image.groups, m.by_error, sensitivities, last, count)
    update_sensitivities(ld, image, m.by_error, m.news, sensitivities)


@kernel
def _follow(sigma: float, axis: Vector, change: Vector, row: Vector) -> None:
    """Let what a turn does to a state, (6,), follow its change (6,)."""
    follow_turn(sigma, axis, change[:VELOCITY], row[:VELOCITY])
    follow_turn(sigma, axis, change[VELOCITY:], row[VELOCITY:])


@kernel
def refer_turns(m: Memory, before: Vector, after: Vector, sensitivities: Matrix) -> None:
    """Let what turns of chaser and camera do to an estimate by coordinates follow it from one state (6,) to another."""
    if not uses_coordinates(m.sensor):
        return
    attitude, mount, change = FIELD_ERRORS - m.fixed["first_error"], m.kept["mount"], m.news[0]
    camera = attitude + ATTITUDE_ERRORS + 1  # behind the focal length
    for i in range(MOTION):
        change[i] = after[i] - before[i]
    for axis in range(3):
        if attitude < sensitivities.shape[0]:
            _follow(m.sensor["attitude_sigma"], mount[axis, :3], change, sensitivities[attitude + axis])
        if camera < sensitivities.shape[0]:
            _follow(m.tolerances["camera_mounting"], mount[axis, :3], change, sensitivities[camera + axis])


@kernel
def start_sensitivities_of_fix(m: Memory, p: Vector, spots: Matrix, by_spots: Matrix, sensitivities: Matrix) -> bool:
    """Set sensitivities (m, 6) of a track that starts at the fix p (3,), docking frame; by_spots (3, 6): at it."""
    if sensitivities.shape[0] == 0:
        return True
    dock, jacobian, e = m.kept["dock"], m.scratch["numbers"], m.scratch["vectors"][0]
    by_beacon, from_angles, places = m.scratch["by_beacon"], m.scratch["three"], m.scratch["places"]
    if not position_from_angles_jacobian(p, from_angles):
        return False
    for i in range(3):
        for k in range(MOTION):
            jacobian[i, k] = 0.0
            for r in range(3):
                jacobian[i, k] += from_angles[i, r] * by_spots[r, k]
    if not position_by_beacon(m.sensor, p, m.scratch["gradients"], by_beacon):
        return False
    for i in range(3):
        place_in_field(m.sensor, spots[i], places[i])
    for j in range(sensitivities.shape[0]):
        error_of_numbers(m, spots, places, jacobian, by_beacon, m.fixed["first_error"] + j, e)
        for i in range(3):
            sensitivities[j, i] = dock[0, i] * e[0] + dock[1, i] * e[1] + dock[2, i] * e[2]
            sensitivities[j, 3 + i] = 0.0
    return True


@kernel
def start_sensitivities_of_planes(m: Memory, track: Record, spots: Matrix, sensitivities: Matrix) -> None:
    """Set sensitivities (m, 6) of a track that starts by least squares over coordinates."""
    if sensitivities.shape[0] == 0:
        return
    for j in range(sensitivities.shape[0]):
        for i in range(MOTION):
            sensitivities[j, i] = 0.0
    image = Observed(m.groups, m.nothing, m.nothing, m.groups[0:0])
    look_at_errors(m, track["state"], sensitivities, spots)
    consider(m, track["ld"], track["state"], image, sensitivities, spots)


@kernel
def add_attitude_noise(m: Memory, track: Record) -> None:
    """Add to a track that starts by least squares what the noise of the attitude does: it turned all coordinates."""
    noise, news, effect = m.sensor["attitude_noise"], m.scratch["numbers"], m.scratch["columns"]
    if noise == 0.0:
        return
    for axis in range(3):
        for i in range(MOTION):
            news[axis, i], effect[axis, i] = 0.0, 0.0
        for i in range(m.turns.shape[0]):
            variance, h = m.groups[i // 2]["variance"][i % 2], m.groups[i // 2]["gradient"][i % 2]
            if variance > 0.0:
                for j in range(3):
                    news[axis, j] += h[j] * noise * m.turns[i, axis] / variance
        add_covariance_times(track["ld"], news[axis], effect[axis])
    for axis in range(3):
        add_rank_one(track["ld"], effect[axis])
