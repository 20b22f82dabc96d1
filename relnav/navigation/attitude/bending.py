"""What errors of a body's attitude and rate do in second order over a long gap: a covariance of long and thin axes.

While nothing is measured the attitude's error grows along the body's path by far faster than across it: momentum and
energy stay as well known as they were. An error of d along the path is off it by d^2 / 2, as the path is bent. After a
gap sigmas of 0.05 and of 1e-6 stand side by side, so that slopes alone, however exact, give a covariance that the truth
leaves by hundreds of sigmas across the path.

The remedy is a second moment: symmetric sigma points of all that is not known are carried beside the estimate x, from
where bending begins to count until something is measured. They are those of `estimation.unscented_attitude`, and a pair
for each error of the inertia: S_k beside x, in a body of that inertia. With y+- their errors about x at any time, and
e = (y+ + y-) / 2 the part of a pair that is even, so not linear,

    P = Phi P Phi^T + Q + sum e e^T / 6                          (Phi, Q: slopes and noise as ever)

for pairs sqrt(6) sigmas from x. A Gaussian error has half of that along one axis; the rest stands for errors along two
axes at once, of which no pair knows. The points stay the same throughout a gap. Drawn anew at every step h they would
lose what they are for: e is then of the order of h, and the sum of its squares vanishes with h, while the truth's
deviation adds up. The estimate itself is left where it is; the mean of e is in the second moment.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel, straight_line
from relnav.codegen.together import quotient
from relnav.dynamics.inertia_error import ENTRIES, INERTIA_ENTRIES
from relnav.dynamics.rigid_body import BODY_ROWS, FRAME_RATE, INERTIA, INVERSE, ORBIT, TORQUE, step_count, turn_body
from relnav.estimation.attitude import TURNING
from relnav.estimation.factored import orthogonalise
from relnav.estimation.unscented_attitude import POINTS, SIGMA_POINTS, spread_points
from relnav.geometry.linear_algebra import invert_three
from relnav.geometry.rotation_vector import rotation_vector_into, turn_by_rotation_vector

LEAST_SHARE = 0.1
"""Of the thinnest sigma: what bending may leave out. It adds the square, 0.01, to one of six parts of NEES."""
PAIRS = TURNING + ENTRIES

BENT = np.dtype(
    [
        ("on", np.int64),  # points are being carried
        ("ld", np.float64, (TURNING, TURNING)),  # the factors of P_noise by slopes alone
        ("even", np.float64, (TURNING, PAIRS)),
        ("points", SIGMA_POINTS),
        ("inertia_dcm", np.float64, (2 * ENTRIES, 3, 3)),  # the points of the inertia's errors
        ("inertia_rate", np.float64, (2 * ENTRIES, 3)),
        ("bodies", np.float64, (2 * ENTRIES, BODY_ROWS, 3)),  # of theirs
    ]
)
"""The points beside a track."""


@straight_line(ld=(TURNING, TURNING))
def thinnest_variance(ld: Matrix, fastest: float) -> float:
    """At most the variance along the thinnest axis of P = L D L^T, at least a sixth of it: 1 / trace of P^-1, rad^2.

    A rate counts as what the attitude turns by meanwhile: over the fastest rate, rad/s.
    """
    inverse, total = np.zeros((TURNING, TURNING)), 0.0
    for i in range(TURNING):
        weight = quotient(1.0, ld[i, i], 0.0)
        for j in range(i + 1):
            inverse[i, j] = 1.0 if i == j else 0.0
            for k in range(j, i):
                inverse[i, j] -= ld[i, k] * inverse[k, j]
            seen = inverse[i, j] if j < 3 else inverse[i, j] * fastest
            total += weight * seen * seen
    return quotient(1.0, total, 0.0)


@straight_line(ld=(TURNING, TURNING), even=(TURNING, PAIRS))
def add_even(ld: Matrix, even: Matrix) -> None:
    """Replace the factors of P by those of P + sum e e^T / 6, e the columns of even (6, PAIRS)."""
    w, weights = np.zeros((TURNING, TURNING + PAIRS)), np.zeros(TURNING + PAIRS)
    for i in range(TURNING):
        weights[i], w[i, i] = ld[i, i], 1.0
        for k in range(i):
            w[i, k] = ld[i, k]
        for k in range(PAIRS):
            w[i, TURNING + k] = even[i, k]
    for k in range(PAIRS):
        weights[TURNING + k] = 1.0 / 6.0
    orthogonalise(w, weights, ld)


@kernel
def is_bent(body: Matrix, track: Record, reach: float) -> bool:
    """Whether an error of reach, rad, leaves the thinnest axis of a track's noise by its bending.

    What is considered is not looked at: it makes thin axes thicker, so that more is followed than need be.
    """
    rate, leak = track["rate"], 0.5 * reach * reach
    speed = math.sqrt(rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2])
    thinnest = thinnest_variance(track["ld"], max(speed, body[ORBIT, FRAME_RATE]))
    return leak * leak > LEAST_SHARE * LEAST_SHARE * thinnest


@kernel
def draw_points(body: Matrix, sigma: Matrix, track: Record, bent: Record, work: Matrix) -> None:
    """Draw the points about a track, and let them be carried; sigma (3, 3) of the inertia; work (4, 3) scratch."""
    spread_points(track, track["ld"], bent["points"], work)
    bent["on"] = 1
    turned, turn, lasting, dcm, rate = work[0:3], work[3], track["lasting"], track["dcm"][:], track["rate"]
    for k in range(2 * ENTRIES):
        size = math.sqrt(6.0) if k % 2 == 0 else -math.sqrt(6.0)
        own = bent["bodies"][k]
        for i in range(3):
            turn[i] = size * lasting[i, k // 2]
            bent["inertia_rate"][k, i] = rate[i] + size * lasting[3 + i, k // 2]
            for j in range(BODY_ROWS):
                own[j, i] = body[j, i]
        turn_by_rotation_vector(dcm, turn, turned)
        for i in range(3):
            for j in range(3):
                bent["inertia_dcm"][k, i, j] = turned[i, j]
        i, j = INERTIA_ENTRIES[k // 2]
        own[INERTIA + i, j] = body[INERTIA + i, j] + size * sigma[i, j]
        own[INERTIA + j, i] = own[INERTIA + i, j]
        invert_three(own[INERTIA : INERTIA + 3], own[INVERSE : INVERSE + 3])


@kernel
def _turn_point(body: Matrix, dcm: Matrix, rate: Vector, dt: float, work: Matrix) -> bool:
    inertia, inverse, orbit = body[INERTIA : INERTIA + 3], body[INVERSE : INVERSE + 3], body[ORBIT]
    count = step_count(rate, orbit[FRAME_RATE], dt)
    for _ in range(count):
        turn_body(dcm, rate, inertia, inverse, orbit, body[TORQUE], dt / count, work)
    return bool(count > 0)


@kernel
def turn_points(body: Matrix, points: Record, dt: float, work: Matrix) -> bool:
    """Carry sigma points over dt; False if nothing is known after it. work (14, 3) scratch."""
    known = True
    for k in range(POINTS):
        known = known and _turn_point(body, points["dcm"][k], points["rate"][k], dt, work)
    return known


@kernel
def carry_points(body: Matrix, bent: Record, of_inertia: bool, dt: float, work: Matrix) -> bool:
    """Carry all points beside a track over dt, those of the inertia if it has errors; as `turn_points`."""
    known = turn_points(body, bent["points"], dt, work)
    if of_inertia:
        for k in range(2 * ENTRIES):
            dcm, rate = bent["inertia_dcm"][k], bent["inertia_rate"][k]
            known = known and _turn_point(bent["bodies"][k], dcm, rate, dt, work)
    return known


@kernel
def bend(track: Record, bent: Record, of_inertia: bool, work: Matrix) -> None:
    """Keep a track's factors, which are of slopes alone, and add the even part of the points; work (1, 3) scratch."""
    ld, even, points, dcm, rate = track["ld"], bent["even"], bent["points"], track["dcm"][:], track["rate"]
    rates, turn = points["rate"], work[0]
    for i in range(TURNING):
        for j in range(TURNING):
            bent["ld"][i, j] = ld[i, j]
        for j in range(PAIRS):
            even[i, j] = 0.0
    for k in range(POINTS):
        rotation_vector_into(points["dcm"][k], dcm, turn)
        for i in range(3):
            even[i, k // 2] += 0.5 * turn[i]
            even[3 + i, k // 2] += 0.5 * (rates[k, i] - rate[i])
    if of_inertia:
        for k in range(2 * ENTRIES):
            rotation_vector_into(bent["inertia_dcm"][k], dcm, turn)
            for i in range(3):
                even[i, TURNING + k // 2] += 0.5 * turn[i]
                even[3 + i, TURNING + k // 2] += 0.5 * (bent["inertia_rate"][k, i] - rate[i])
    add_even(ld, even)


@kernel
def unbend(track: Record, bent: Record) -> None:
    """Give a track its factors by slopes alone again."""
    for i in range(TURNING):
        for j in range(TURNING):
            track["ld"][i, j] = bent["ld"][i, j]
