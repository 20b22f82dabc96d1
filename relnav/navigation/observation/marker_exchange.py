"""Whether an image that a hypothesis does not explain is one whose markers have changed places."""

import math

from relnav.arrays import Matrix, Record, Stack
from relnav.codegen.kernel import kernel
from relnav.estimation.rows import Observed, pair_covariance, sweep
from relnav.navigation.observation.marker_rows import has_spot, observe_markers
from relnav.navigation.pose_memory import PoseMemory


@kernel
def gates_share(m: PoseMemory, ld: Matrix, count: int) -> float:
    """Largest share of the image that a gate of the groups covers, ld being the factors before the image."""
    size, largest = m.camera["size"], 0.0
    for k in range(count):
        xx, xy, yy = pair_covariance(ld, m.groups[k]["gradient"], m.groups[k]["variance"], m.noise[2 * k, 2 * k + 1])
        area = math.pi * m.gate[1] * math.sqrt(max(0.0, xx * yy - xy * xy))
        share = area / (size[0] * size[1])
        if not share <= largest:  # NaN counts as large
            largest = share
    return largest


@kernel
def _fits(m: PoseMemory, track: Record, sensitivities: Matrix, covariances: Stack, largest_share: float) -> bool:
    """Whether the spots as they stand in `exchanged` are all credible, through gates that are small."""
    seen, count = observe_markers(m, track, sensitivities, m.exchanged, covariances)
    if count < seen or not gates_share(m, track["ld"], count) < largest_share:
        return False
    n = 2 * count
    image = Observed(m.groups[:count], m.noise[:n, :n], m.factor[:n, :n], m.independent[:count])
    nis, dof = sweep(track, track["state"], image, m.work)
    return bool(dof > 0 and nis <= m.gate[dof - 1])


@kernel
def is_exchanged(
    m: PoseMemory,
    track: Record,
    sensitivities: Matrix,
    spots: Matrix,
    covariances: Stack,
    seen: int,
    largest_share: float,
) -> bool:
    """Whether the image (n, 2) px fits a hypothesis once two of its spots change places, or its three go round.

    Covariances stay with their markers. largest_share: of the image, that a gate may cover.
    """
    n, out = spots.shape[0], m.exchanged
    for i in range(n):
        for j in range(i):
            for k in range(n):  # k = i: a pair
                if not (has_spot(spots, i) and has_spot(spots, j) and has_spot(spots, k)):
                    continue
                if k == j or (k != i and seen > 3):
                    continue
                for row in range(n):
                    out[row, 0], out[row, 1] = spots[row, 0], spots[row, 1]
                for c in range(2):
                    out[i, c], out[j, c] = spots[j, c], spots[k, c]
                    if k != i:
                        out[k, c] = spots[i, c]
                if _fits(m, track, sensitivities, covariances, largest_share):
                    return True
    return False
