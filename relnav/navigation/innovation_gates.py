"""How large an innovation may be: 1-sigma of each number of an image, found again from the track.

A filter keeps the covariance P after the update, not the one before. Where an image was used whole, with H its gradient
and R its noise,

    S = H P- H' + R = R (R - H P H')^-1 R,

for H P H' = R - R S^-1 R (Bar-Shalom, Li, Kirubarajan 2001, section 5.2, by the gain W = P- H' S^-1 = P H' R^-1). Where
nothing was used, P is P-. A test holds e' S^-1 e of innovations e against the filter's own NIS.
"""

import numpy as np

from relnav.arrays import Codes, Matrix
from relnav.dynamics.error_state import MOTION
from relnav.mission import Model
from relnav.navigation.arguments import choose
from relnav.navigation.memory import views
from relnav.navigation.observation.beacon_geometry import uses_coordinates
from relnav.navigation.record import Solution
from relnav.navigation.status import REJECTED, UPDATED
from relnav.navigation.steady_state_filter import rows_at


def innovation_covariances(model: Model, solution: Solution, at: Codes) -> list[Matrix]:
    """S of the whole image at some epochs, each (k, k) as the innovations: m, or m and rad for `fix`.

    Empty (0, 0) where it cannot be told: nothing was seen or not all of it was, the epoch was used in part, the track
    is smoothed or considers lasting errors, the camera's attitude is not the model's.

    Parameters
    ----------
    model : Model
        The mission that was flown; spots seen from its held attitude.
    solution : Solution
        Filtered with it.
    at : (m,)
        Numbers of the epochs.
    """
    unknown = np.empty((0, 0))
    if solution.smoothed or solution.metadata.get("considered") or len(solution.lever_lvlh_m) > 1:
        return [unknown] * len(at)
    m, seen = views(choose(model, solution.method, None, "compiled")), np.ones(len(model.beacons_lvlh_m), dtype=bool)
    numbers = 2 * len(seen) if uses_coordinates(m.sensor) else 3
    out = []
    for e in map(int, at):
        status, h = int(solution.status[e]), np.empty((0, MOTION))
        if status in (UPDATED, REJECTED) and int(solution.dof[e]) == numbers:
            h, r, _ = rows_at(model, m, solution.state[e, :3], seen)
        if len(h) != numbers:
            out.append(unknown)
            continue
        after = h @ solution.part(e, e + 1).covariance[0] @ h.T
        s = after + r if status == REJECTED else r @ np.linalg.solve(r - after, r)
        out.append(0.5 * (s + s.T) if bool(np.all(np.diagonal(s) > 0.0)) else unknown)
    return out
