"""Filter a raw log: whole images until the filter has started, then (`spots`) every spot at its own time.

A start needs one image of all three beacons; from then on the `spots` filter takes each slot's spot when it was seen.
When the track is lost, a new filter starts on images again. While it is locked out (half of what is seen rejected for
`restart_after_epochs` cycles), a start is looked for beside it, and takes its place if there is one. The closed form
(`fix`) and an unknown attitude need all three beacons at once: they are given images throughout.
"""

import dataclasses
from typing import Any

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.mission import Model
from relnav.navigation.log import filter_epochs
from relnav.navigation.record import PER_EPOCH, Solution
from relnav.navigation.status import PARTIAL, REJECTED, STARTED, WAITING
from relnav.sensors.three_beacon.slots import Slots


def filter_slots(
    model: Model,
    slots: Slots,
    *,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_cam_from_lvlh: Matrix | None = None,
    method: str = "fix",
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
    (spots, spot_sigma), (images, image_sigma) = slots.epochs(), slots.images()
    sigma = np.where(np.isnan(spot_sigma), image_sigma, spot_sigma)  # an image's own beacons have no other
    each_slot = method == "spots" and (model.attitude.mode == "lvlh_hold" or q_cam_from_lvlh is not None)

    def run(begin: int, part: Stack) -> Solution:
        def cut(values: Vector | None) -> Vector | None:
            return None if values is None else values[begin : begin + len(part)]

        return filter_epochs(
            model,
            slots.t_s[begin : begin + len(part)],
            part,
            acceleration_m_s2=cut(acceleration_m_s2),
            delta_v_m_s=cut(delta_v_m_s),
            q_cam_from_lvlh=cut(q_cam_from_lvlh),
            method=method,
            spot_sigma_m=sigma[begin : begin + len(part)],
            projection=projection,
            smooth=smooth,
        )

    if not each_slot:
        return run(0, images)
    pieces: list[Solution] = []
    n, begin, first = len(slots.t_s), 0, 0  # rows in all, rows answered, and where the filter at work begins
    while begin < n:
        switch = min(n, first + _rows_to_start(run(first, images[first:])))
        mixed = np.concatenate([images[first:switch], spots[switch:]])
        track = run(first, mixed)
        end = after = first + _lost(track, switch - first)
        locked = first + _locked_out(track, mixed, switch - first, 3 * model.filter.restart_after_epochs)
        locked = locked[locked < end]
        while locked.size:
            row = int(locked[0])
            start = row + _rows_to_start(run(row, images[row:])) - 1
            if start in locked:
                end, after = start, row
                break
            locked = locked[locked > start]
        whole = track if end == n else run(first, mixed[: end - first])  # a smoother must not look beyond its end
        pieces.append(whole.part(begin - first, end - first))
        begin, first = end, after
    return _joined(pieces)


def _rows_to_start(track: Solution) -> int:
    """Rows up to and with the one that confirms a start; more than there are, if none does."""
    started = np.flatnonzero(track.status == STARTED)
    return int(started[0]) + 1 if started.size else len(track) + 1


def _lost(track: Solution, first: int) -> int:
    """Row at or after `first` at which the track is lost, or the number of rows if it is not."""
    lost = np.flatnonzero(track.status[first:] == WAITING)
    return first + int(lost[0]) if lost.size else len(track)


def _locked_out(track: Solution, spots: Stack, first: int, window: int) -> Codes:
    """Rows at which half or more of the last `window` spots were rejected; `first` is where spots come singly."""
    rows = np.flatnonzero(np.isfinite(spots[first:]).any(axis=(1, 2))) + first
    if len(rows) < window:
        return np.empty(0, dtype=np.int64)
    rejected = np.isin(track.status[rows], (REJECTED, PARTIAL)).astype(np.float64)
    share = np.convolve(rejected, np.ones(window), mode="valid") / window
    return rows[window - 1 :][share >= 0.5]


def _joined(pieces: list[Solution]) -> Solution:
    """Tracks one after the other as one solution; every piece but the first begins with a restart."""
    if len(pieces) == 1:
        return pieces[0]
    arrays: dict[str, Any] = {name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in PER_EPOCH}
    if all(len(piece.lever_lvlh_m) == len(piece) for piece in pieces):
        arrays["lever_lvlh_m"] = np.concatenate([piece.lever_lvlh_m for piece in pieces])
    starts = int((arrays["status"] == STARTED).sum())
    return dataclasses.replace(pieces[0], **arrays, restarts=max(0, starts - 1))
