"""Filter a raw log: whole images until the filter has started, then every spot at its own time.

A start needs one image of all three beacons; from then on the `spots` filter takes each slot's spot when it was seen.
When the track is lost, or locked out (half of what is seen rejected for `restart_after_epochs` cycles), a new filter
starts on images again. The closed form (`fix`) and an unknown attitude need all three beacons at once: they are given
images throughout.
"""

import dataclasses
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Model
from relnav.navigation.record import PER_EPOCH, Solution
from relnav.navigation.relative_position import filter_epochs
from relnav.navigation.status import PARTIAL, REJECTED, STARTED, WAITING
from relnav.sensors.three_beacon.slots import Slots


def filter_slots(
    model: Model,
    slots: Slots,
    *,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_cam_from_lvlh: Matrix | None = None,
    method: str = "spots",
    projection: str | None = None,
    smooth: bool = False,
) -> Solution:
    """Filter slots into a track, one entry a slot, dark ones included.

    Parameters
    ----------
    model : Model
        Mission.
    slots : Slots
        From `read_slots`.
    acceleration_m_s2, delta_v_m_s, q_cam_from_lvlh, method, projection, smooth
        As for `filter_epochs`, a row a slot.
    """
    mission = _with_noise_of(model, slots)
    spots, _ = slots.epochs()
    images, _ = slots.images()
    each_slot = method == "spots" and (model.attitude.mode == "lvlh_hold" or q_cam_from_lvlh is not None)

    def run(begin: int, part: Stack) -> Solution:
        def cut(values: Vector | None) -> Vector | None:
            return None if values is None else values[begin : begin + len(part)]

        return filter_epochs(
            mission,
            slots.t_s[begin : begin + len(part)],
            part,
            acceleration_m_s2=cut(acceleration_m_s2),
            delta_v_m_s=cut(delta_v_m_s),
            q_cam_from_lvlh=cut(q_cam_from_lvlh),
            method=method,
            projection=projection,
            smooth=smooth,
        )

    if not each_slot:
        return run(0, images)
    pieces, begin, n = [], 0, len(slots.t_s)
    while begin < n:
        started = np.flatnonzero(run(begin, images[begin:]).status == STARTED)
        if started.size == 0:
            pieces.append(run(begin, images[begin:]))
            break
        switch = begin + int(started[0]) + 1
        mixed = np.concatenate([images[begin:switch], spots[switch:]])
        track = run(begin, mixed)
        end = _end_of_track(track, mixed, switch - begin, model.filter.restart_after_epochs)
        pieces.append(track if end == len(track) else run(begin, mixed[:end]))
        begin += end
    return _joined(pieces)


def _with_noise_of(model: Model, slots: Slots) -> Model:
    """The model with the log's own spot noise: rms of what the received power says, as one number."""
    if not np.isfinite(slots.sigma_m).any():
        return model
    sigma = float(np.sqrt(np.nanmean(slots.sigma_m**2)))
    return dataclasses.replace(model, sensor=dataclasses.replace(model.sensor, spot_noise_m=sigma))


def _end_of_track(track: Solution, spots: Stack, first: int, cycles: int) -> int:
    """Row at which the track is lost or locked out, or the number of rows if it is not."""
    lost = np.flatnonzero(track.status[first:] == WAITING)
    end = first + int(lost[0]) if lost.size else len(track)
    rows = np.flatnonzero(np.isfinite(spots[first:end]).any(axis=(1, 2))) + first
    window = 3 * cycles
    if len(rows) >= window:
        rejected = np.isin(track.status[rows], (REJECTED, PARTIAL)).astype(np.float64)
        share = np.convolve(rejected, np.ones(window), mode="valid") / window
        locked = np.flatnonzero(share >= 0.5)
        if locked.size:
            end = min(end, int(rows[locked[0] + window - 1]) + 1)
    return max(end, first)


def _joined(pieces: list[Solution]) -> Solution:
    """Tracks one after the other as one solution; every piece but the first begins with a restart."""
    if len(pieces) == 1:
        return pieces[0]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in PER_EPOCH}
    starts = int((arrays["status"] == STARTED).sum())
    return dataclasses.replace(pieces[0], **arrays, restarts=max(0, starts - 1))
