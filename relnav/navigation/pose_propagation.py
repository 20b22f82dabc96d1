"""From one event to the next: hypotheses of the marker filter, carried with their twelve errors."""

import math

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import kernel, straight_line, variant
from relnav.codegen.trace import Shape
from relnav.dynamics import rigid_body
from relnav.dynamics.error_state import MOTION, POSE, RATE, ROTATION, THETA
from relnav.dynamics.relative_motion import frame_and_gradient
from relnav.dynamics.rigid_body import FRAME_RATE, GRADIENT, ORBIT
from relnav.dynamics.yamanaka_ankersen import PHI_PATTERN
from relnav.estimation.considered import is_felt
from relnav.estimation.factored import factorize_into, time_update_into
from relnav.estimation.lasting_evidence import fade
from relnav.estimation.rows import copy_rows, copy_track
from relnav.geometry.rotation_vector import rotation_vector_into
from relnav.navigation.pose_bending import carry_pairs, draw_pairs
from relnav.navigation.pose_inertia import push_sensitivities, turn_uncertain
from relnav.navigation.propagation import carry_state_eccentric, multiply

rotate_into = rigid_body.propagate_into

MEMORY_S = 50.0
"""Of the scores: what a filter was before it settled is forgotten."""
LARGEST_TURN_RAD = 0.3
LARGEST_SHARE_OF_RANGE = 0.2
"""1-sigma of attitude and position up to which errors count as small (tests: NEES after gaps)."""

POSE_PHI_PATTERN: Shape = (*(row + "0" * ROTATION for row in PHI_PATTERN), *("0" * MOTION + "*" * ROTATION,) * ROTATION)
POSE_NOISE_PATTERN: Shape = (
    *("*" * MOTION + "0" * ROTATION,) * MOTION,
    *("0" * MOTION + "*" * ROTATION,) * ROTATION,
)


@straight_line(ld=(POSE, POSE), phi=POSE_PHI_PATTERN, noise=POSE_NOISE_PATTERN)
def carry_errors(ld: Matrix, phi: Matrix, noise: Matrix) -> None:
    """Carry the factors over a step: motion and rotation go their own ways, noise (factors of Q) likewise."""
    time_update_into(ld, phi, noise)


multiply_pose = variant(multiply, "multiply_pose", phi=POSE_PHI_PATTERN, vector=(POSE,))


@kernel
def carry_sensitivities(body: Record, phi: Matrix, sensitivities: Matrix) -> None:
    """Carry what lasting errors do to a hypothesis, (m, 12), over the step that it has taken."""
    for c in range(sensitivities.shape[0]):
        if is_felt(sensitivities[c]):
            multiply_pose(phi, sensitivities[c])
    if body["inertia_errors"] > 0:
        push_sensitivities(body, sensitivities)


@kernel
def copy_place(source: Record, target: Record) -> None:
    """Copy motion, attitude and rate, of a hypothesis or of an epoch."""
    for i in range(MOTION):
        target["motion"][i] = source["motion"][i]
    for i in range(3):
        target["rate"][i] = source["rate"][i]
        for j in range(3):
            target["dcm"][i, j] = source["dcm"][i, j]


@kernel
def copy_pose(source: Record, target: Record) -> None:
    """Copy a hypothesis."""
    copy_track(source, target)
    copy_place(source, target)
    target["score"], target["doubt"] = source["score"], source["doubt"]
    target["prior"], target["added"] = source["prior"], source["added"]


@kernel
def odds_against(one: Record, lead: Record) -> float:
    """Twice the log of the odds of the leading hypothesis against another, less what that may have lost undeserved."""
    return float((one["score"] + one["prior"] - one["doubt"]) - (lead["score"] + lead["prior"]))


@kernel
def errors_between(one: Record, other: Record, errors: Vector) -> None:
    """Write by what errors (12,) another hypothesis is off one."""
    for i in range(MOTION):
        errors[i] = other["motion"][i] - one["motion"][i]
    rotation_vector_into(other["dcm"], one["dcm"], errors[THETA:RATE])
    for i in range(3):
        errors[RATE + i] = other["rate"][i] - one["rate"][i]


@kernel
def advance_pose(
    body: Record, step: Record, scratch: Record, orbit: Vector, track: Record, t: float, dt: float
) -> bool:
    """Carry a hypothesis over the prepared step from t over dt s; the orbit turns as in the middle of the step.

    False for so many turns of the target that nothing is known of its attitude after them.
    """
    phi, noise = scratch["phi"], scratch["noise"]
    turn, spread_, factors, values = body["phi"], body["noise"], body["factors"], body["values"]
    values[ORBIT, FRAME_RATE], values[ORBIT, GRADIENT] = frame_and_gradient(orbit, t + 0.5 * dt)
    if body["inertia_errors"] > 0:
        if not turn_uncertain(body, dt, track["dcm"], track["rate"]):
            return False
    elif not rotate_into(values, dt, track["dcm"], track["rate"], body["noise_density"], turn, spread_, body["work"]):
        return False
    carry_state_eccentric(track["motion"], step["phi"], step["effect"], track["motion"])
    for i in range(MOTION):
        for j in range(i):
            spread_[i, j] = 0.5 * (spread_[i, j] + spread_[j, i])
            spread_[j, i] = spread_[i, j]
    if not factorize_into(spread_, factors):
        factors[0, 0] = math.nan
    for i in range(MOTION):
        for j in range(MOTION):
            phi[i, j], phi[MOTION + i, MOTION + j] = step["phi"][i, j], turn[i, j]
            noise[i, j], noise[MOTION + i, MOTION + j] = step["noise"][i, j], factors[i, j]
            noise[MOTION + i, j] = 0.0  # an update left a covariance there, which plain Python does not skip
    carry_errors(track["ld"], phi, noise)
    return True


@kernel
def variance(ld: Matrix, i: int) -> float:
    """P_ii of the factors."""
    total = ld[i, i]
    for j in range(i):
        total += ld[i, j] * ld[i, j] * ld[j, j]
    return float(total)


@kernel
def _whole_variance(ld: Matrix, inertia: Matrix, i: int) -> float:
    """P_ii of the factors, with what the errors of the inertia have done, (k, 12)."""
    total = variance(ld, i)
    for k in range(inertia.shape[0]):
        total += inertia[k, i] * inertia[k, i]
    return total


@kernel
def _largest_variance(ld: Matrix, inertia: Matrix, first: int) -> float:
    x, y = _whole_variance(ld, inertia, first), _whole_variance(ld, inertia, first + 1)
    return max(x, y, _whole_variance(ld, inertia, first + 2))


@kernel
def is_wide(track: Record, inertia: Matrix) -> bool:
    """Whether errors are no longer small: a full image then tells more than the state that it would correct.

    inertia (k, 12): what the errors of the inertia have done to it.
    """
    ld, rho = track["ld"], track["motion"]
    share2 = _largest_variance(ld, inertia, 0) / (rho[0] * rho[0] + rho[1] * rho[1] + rho[2] * rho[2])
    wide_turn = _largest_variance(ld, inertia, THETA) > LARGEST_TURN_RAD * LARGEST_TURN_RAD
    return wide_turn or not share2 <= LARGEST_SHARE_OF_RANGE * LARGEST_SHARE_OF_RANGE


@kernel
def _is_forgotten(body: Record, track: Record, inertia: Matrix, dt: float) -> bool:
    """Whether after dt nothing is known of the attitude any more: 1-sigma of half a turn."""
    drift = body["noise_density"] * dt * dt * dt / 3.0
    turn, rate = _largest_variance(track["ld"], inertia, THETA), _largest_variance(track["ld"], inertia, RATE)
    known = turn + rate * dt * dt + drift
    return not known <= math.pi * math.pi


@kernel
def _advance_bent(
    body: Record,
    step: Record,
    scratch: Record,
    orbit: Vector,
    track: Record,
    inertia: Matrix,
    bent: Record,
    t: float,
    dt: float,
) -> bool:
    """`advance_pose` of a hypothesis whose bending is followed."""
    before, ld = scratch["pose"], track["ld"]
    reach = math.sqrt(_largest_variance(ld, inertia, THETA)) + dt * math.sqrt(_largest_variance(ld, inertia, RATE))
    draw_pairs(body, scratch, track, bent, reach, dt)
    for i in range(3):
        before[3, i] = track["rate"][i]
        for j in range(3):
            before[i, j] = track["dcm"][i, j]
    if not advance_pose(body, step, scratch, orbit, track, t, dt):
        return False
    if bent["on"] > 0:
        carry_pairs(body, scratch, track, inertia, bent, dt)
    return True


@kernel
def _copy_bent(source: Record, target: Record) -> None:
    target["on"], target["age"] = source["on"], source["age"]
    copy_rows(source["pairs"], target["pairs"])
    copy_rows(source["even"], target["even"])
    copy_rows(source["inertia_even"], target["inertia_even"])


@kernel
def advance_bank(
    body: Record,
    step: Record,
    scratch: Record,
    orbit: Vector,
    bank: Record,
    sensitivities: Stack,
    evidence: Stack,
    bents: Record,
    count: int,
    t: float,
    dt: float,
) -> int:
    """Carry the hypotheses over dt, those left out of which nothing would be known; returns how many remain.

    sensitivities (hypotheses, m, 12), evidence (hypotheses, m + 1, m) and bents: of each. bents are none for a trial.
    """
    kept, first = 0, sensitivities.shape[1] - body["inertia_errors"]
    share = math.exp(-dt / MEMORY_S)
    for k in range(count):
        if not _is_forgotten(body, bank[k], sensitivities[k, first:], dt):
            if kept < k:
                copy_pose(bank[k], bank[kept])
                copy_rows(sensitivities[k], sensitivities[kept])
                copy_rows(evidence[k], evidence[kept])
                if bents.shape[0] > 0:
                    _copy_bent(bents[k], bents[kept])
            if bents.shape[0] > 0:
                own = sensitivities[kept, first:]
                known = _advance_bent(body, step, scratch, orbit, bank[kept], own, bents[kept], t, dt)
            else:
                known = advance_pose(body, step, scratch, orbit, bank[kept], t, dt)
            if known:
                carry_sensitivities(body, scratch["phi"], sensitivities[kept])
                bank[kept]["score"], bank[kept]["doubt"] = share * bank[kept]["score"], share * bank[kept]["doubt"]
                if count > 1:
                    fade(evidence[kept], share)
                kept += 1
    return kept
