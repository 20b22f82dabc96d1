"""What is kept of an epoch of the marker filter: one record, written by compiled code."""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import MOTION, POSE, factor_size
from relnav.estimation.considered import join_considered
from relnav.estimation.factored import compose_into
from relnav.estimation.rows import copy_rows
from relnav.navigation.packed_factors import pack_factors, unpack_factors
from relnav.navigation.pose_bending import add_bends
from relnav.navigation.pose_memory import PoseMemory, pose_views
from relnav.navigation.pose_propagation import copy_place, odds_against
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

LOWER = np.tril_indices(POSE)
"""Rows and columns of packed factors."""

SETTLED_S = 3.9
"""After the leading hypothesis was too wide to tell roots apart: until roots that it has left are found again."""

_F, _I = np.float64, np.int64

EPOCH = np.dtype(
    [
        ("t", _F),
        ("motion", _F, MOTION),
        ("dcm", _F, (3, 3)),
        ("rate", _F, 3),
        ("factor", _F, factor_size(POSE)),  # lower triangle of `ld`, row by row
        ("by_chaser", _F, (3, POSE)),  # what one sigma of the chaser's attitude error, each axis, has done to the state
        ("acceleration", _F, 3),  # over the interval that ends here
        ("delta_v", _F, 3),
        ("chaser", _F, (3, 3)),  # dcm_chaser_from_lvlh
        ("nis", _F),
        ("ambiguity", _F),
        ("dof", _I),
        ("status", _I),
        ("hypotheses", _I),
        ("used", _I),
        ("observable", _I),
        ("too_late", _I),
        ("alarm", _I),
        ("row", _I),  # an epoch of the log, not the exposure of a late image
    ]
)
"""What is kept of an epoch."""


@kernel
def _spans_a_plane(s: Matrix, used_s: Vector, t: float, limit_s: float) -> bool:
    """Whether the markers used within the limit are all of them, or three or more that do not stand on one line."""
    recent, first, second, longest2 = 0, 0, 0, -1.0
    n = s.shape[0]
    for i in range(n):
        recent += 1 if t - used_s[i] <= limit_s else 0
    if recent == n or recent < 3:
        return bool(recent == n)
    for i in range(n):
        for j in range(i):
            if t - used_s[i] <= limit_s and t - used_s[j] <= limit_s:
                d2 = (s[i, 0] - s[j, 0]) ** 2 + (s[i, 1] - s[j, 1]) ** 2 + (s[i, 2] - s[j, 2]) ** 2
                if d2 > longest2:
                    first, second, longest2 = i, j, d2
    for i in range(n):
        if t - used_s[i] <= limit_s:
            a0, a1, a2 = s[i, 0] - s[first, 0], s[i, 1] - s[first, 1], s[i, 2] - s[first, 2]
            b0, b1, b2 = s[second, 0] - s[first, 0], s[second, 1] - s[first, 1], s[second, 2] - s[first, 2]
            c0, c1, c2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
            if c0 * c0 + c1 * c1 + c2 * c2 > 1e-12 * longest2 * longest2:
                return True
    return False


@kernel
def write_covariance(
    ld: Matrix, sensitivities: Matrix, apart: Matrix, work: Matrix, factor: Vector, by_chaser: Matrix
) -> None:
    """Write packed factors, joined with what is considered, or that apart (m, 12) where there is room.

    work (12, 12) is scratch.
    """
    for c in range(3):
        for i in range(POSE):
            by_chaser[c, i] = sensitivities[c, i]
    if apart.shape[0] > 0:
        copy_rows(sensitivities, apart)
        pack_factors(ld, factor)
        return
    copy_rows(ld, work)
    join_considered(work, sensitivities)
    pack_factors(work, factor)


@kernel
def odds_of(m: PoseMemory) -> float:
    """Odds of the leading hypothesis against the next, less what the next may have lost by its bending."""
    odds = math.inf
    for k in range(1, m.clock["running"]):
        odds = min(odds, odds_against(m.bank[k], m.bank[0]))
    return odds


@kernel
def _is_undecided(m: PoseMemory) -> bool:
    """Whether odds do not count yet.

    That is while the leader is, or was lately, so wide that it may cover several roots, and where a pose that was
    beaten has not had its second hypothesis.
    """
    clock = m.clock
    return bool(clock["t"] - clock["blurred"] <= SETTLED_S or clock["renewed"] == -math.inf)


@kernel
def ambiguity_of(m: PoseMemory) -> float:
    """These odds; zero at most where they do not count yet."""
    odds = odds_of(m)
    return min(odds, 0.0) if _is_undecided(m) else odds


@kernel
def is_contested(m: PoseMemory) -> bool:
    """Whether the leading one is not relied on, but for hypotheses that began less likely beside it."""
    contested, lead = _is_undecided(m), m.bank[0]
    for k in range(1, m.clock["running"]):
        if m.bank[k]["prior"] <= lead["prior"] and odds_against(m.bank[k], lead) < AMBIGUITY_LIMIT:
            contested = True
    return contested


@kernel
def write_epoch(m: PoseMemory, out: Record, apart: Matrix) -> None:
    """Write what the filter says after its last event.

    apart (m, 12): room for what considered errors have done, `factor` then being the filter's own; (0, 12): joined.
    """
    clock, result, lead = m.clock, m.result, m.bank[0]
    push, impulse, chaser = out["acceleration"], out["delta_v"], out["chaser"]
    count = clock["running"]
    for i in range(3):
        push[i], impulse[i] = m.motion["acceleration"][i], m.motion["delta_v"][i]
        for j in range(3):
            chaser[i, j] = m.camera["chaser"][i, j]
    out["t"], out["nis"], out["dof"], out["status"] = clock["t"], result["nis"], result["dof"], result["status"]
    out["hypotheses"], out["too_late"], out["row"] = count, 0, 1
    out["ambiguity"], out["alarm"] = ambiguity_of(m), result["alarm"]
    out["observable"] = (
        1 if count > 0 and _spans_a_plane(m.points, m.used_s, clock["t"], m.fixed["few_markers_limit"]) else 0
    )
    used = 0
    for i in range(m.accepted.shape[0]):
        used += 1 if m.accepted[i] > 0.0 else 0
    out["used"] = used
    if count > 0:
        copy_place(lead, out)
        ld = lead["ld"]
        if m.bents[0]["on"] > 0:
            copy_rows(ld, m.spare[0]["ld"])
            ld = m.spare[0]["ld"]
            add_bends(m.bents[0], m.body["inertia_errors"], ld)
        write_covariance(ld, m.bank_sensitivities[0], apart, m.work["ld"], out["factor"], out["by_chaser"])
        return
    motion, dcm, rate, factor = out["motion"], out["dcm"], out["rate"], out["factor"]
    motion[:], dcm[:], rate[:], factor[:], apart[:] = math.nan, math.nan, math.nan, math.nan, math.nan


@entry
def read_epoch(block: Vector, out: Record, apart: Stack) -> None:
    """`write_epoch` of a filter's memory into the first of out (1,) and of apart (1, m, 12)."""
    write_epoch(pose_views(block), out[0], apart[0])


_SQUARES = np.dtype([("ld", _F, (POSE, POSE)), ("p", _F, (POSE, POSE))])


@entry
def _compose(packed: Matrix, work: Record, covariances: Stack) -> None:
    """Write covariances (n, 12, 12) of packed factors (n, 78); work: `_SQUARES`."""
    ld, p = work["ld"], work["p"]
    for e in range(packed.shape[0]):
        unpack_factors(packed[e], ld)
        compose_into(ld, p)
        copy_rows(p, covariances[e])


def covariances_of(packed: Matrix) -> Stack:
    """Covariances (n, 12, 12) of packed factors (n, 78)."""
    out = np.empty((len(packed), POSE, POSE))
    _compose(np.ascontiguousarray(packed), np.zeros((), _SQUARES)[()], out)
    return out
