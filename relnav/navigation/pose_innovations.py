"""What each marker's spot was off its prediction, and its 1-sigma, found again from a filtered track and its log.

The filter keeps what it knew after an image. Of that the epoch before is carried to the image as the filter carried it
(`pose_propagation`), and the spots are compared as it compared them (`marker_rows`): so no step pays for what few look
at. Of the covariance P of an epoch, what is considered is in it, with s what one sigma of the chaser's attitude has
done to the state and c what it does to a spot,

    S = H P H' - (H s)(H s)' + (c - H s)(c - H s)' + R

Tests hold residuals and S against `engine="filterpy"` and the filter's own NIS.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record, Stack, Vector
from relnav.codegen.kernel import entry, kernel
from relnav.dynamics.error_state import POSE
from relnav.estimation.rows import pair_covariance
from relnav.mission import VisionMission
from relnav.navigation.blocks import MOUNTING, marker_considered
from relnav.navigation.observation.marker_rows import aim_camera, observe_markers
from relnav.navigation.packed_factors import unpack_factors
from relnav.navigation.pose_epoch import EPOCH
from relnav.navigation.pose_memory import PoseMemory, new_pose_memory, pose_views
from relnav.navigation.pose_propagation import advance_pose, carry_sensitivities, copy_place
from relnav.navigation.pose_record import PoseSolution
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import PARTIAL, REJECTED, UPDATED


@kernel
def _predict(m: PoseMemory, before: Record, epoch: Record) -> bool:
    """Write into the first of the bank what was known just before an epoch's image; False where nothing was."""
    track, effects, dt = m.bank[0], m.bank_sensitivities[0], epoch["t"] - before["t"]
    if before["hypotheses"] == 0 or not dt >= 0.0:
        return False
    for i in range(3):
        m.motion["acceleration"][i], m.motion["delta_v"][i] = epoch["acceleration"][i], epoch["delta_v"][i]
    copy_place(before, track)
    unpack_factors(before["factor"], track["ld"])
    for c in range(effects.shape[0]):
        for j in range(POSE):
            effects[c, j] = before["by_chaser"][c, j] if c < 3 else 0.0
    prepare_step(m.step, m.motion, m.scratch, before["t"], dt)
    orbit, taken = m.motion["orbit"], m.step["dt"]
    if not advance_pose(m.body, m.step, m.scratch, orbit, track, before["t"], taken):
        return False
    carry_sensitivities(m.body, m.scratch["phi"], effects)
    return True


@kernel
def _counted_twice(gradient: Vector, effects: Matrix) -> float:
    """(H s)(H s)' of a row."""
    total = 0.0
    for c in range(effects.shape[0]):
        taken = 0.0
        for j in range(POSE):
            taken += gradient[j] * effects[c, j]
        total += taken * taken
    return total


@entry
def _compare(block: Vector, epochs: Record, spots: Stack, covariances: Stack, out: Stack) -> None:
    """Write into out (n, markers, 4) innovation and sigma, x and y, px, of each spot of epochs (n + 1,) but the first.

    spots (n, markers, 2); covariances (n, markers, 2, 2), or AS_STATED; out is left as it is where there is no telling.
    """
    m = pose_views(block)
    for e in range(spots.shape[0]):
        before, epoch = epochs[e], epochs[e + 1]
        status = epoch["status"]
        if status not in (UPDATED, PARTIAL, REJECTED) or not _predict(m, before, epoch):
            continue
        aim_camera(m.camera, epoch["chaser"])
        own = covariances[e if covariances.shape[0] > 1 else 0]
        _, count = observe_markers(m, m.bank[0], m.bank_sensitivities[0], spots[e], own)
        for g in range(count):
            group, row = m.groups[g], out[e, int(m.which[g])]
            gradient = group["gradient"]
            xx, _, yy = pair_covariance(m.bank[0]["ld"], gradient, group["variance"], m.noise[2 * g, 2 * g + 1])
            row[0], row[1] = group["residual"][0], group["residual"][1]
            row[2] = math.sqrt(xx - _counted_twice(gradient[0], m.bank_sensitivities[0]))
            row[3] = math.sqrt(yy - _counted_twice(gradient[1], m.bank_sensitivities[0]))


class MarkerInnovations:
    """Innovations of consecutive parts of one filtered track.

    Attributes
    ----------
    tells_sigma : bool
        False where lasting errors beyond the chaser's attitude are considered: the track does not keep what they did.
    """

    def __init__(self, mission: VisionMission) -> None:
        """Begin before the first epoch."""
        self._memory, self._before = new_pose_memory(mission), np.zeros(1, EPOCH)
        self.tells_sigma = marker_considered(mission) <= MOUNTING

    def of(self, part: PoseSolution) -> tuple[Stack, Stack]:
        """Innovation and 1-sigma of each spot of the next epochs, (n, markers, 2) px each.

        NaN where a spot was not seen or not compared, of the first images of a track, of a smoothed track, and where
        the part does not know its spots (`PoseSolution.spots_px`).
        """
        count = len(pose_views(self._memory).points)
        out = np.full((len(part), count, 4), math.nan)
        if not part.smoothed and part.spots_px is not None and len(part):
            epochs = np.concatenate([self._before, part.epochs])
            covariances = np.ascontiguousarray(part.spot_covariance_px2)
            _compare(self._memory, epochs, np.ascontiguousarray(part.spots_px), covariances, out)
            self._before = epochs[-1:]
        if not self.tells_sigma:
            out[:, :, 2:] = math.nan
        return out[:, :, :2], out[:, :, 2:]
