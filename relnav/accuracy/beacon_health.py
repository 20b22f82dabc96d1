"""Whether the beacons are what they should be, judged by a track: dead, losing power, exchanged, or mirrored.

Given where the track says the camera is, each slot has a place where its spot should be and a current that it should
draw. A beacon that gives no light while it should be in view is dead; one whose current falls against the expected
one is losing power; rejected spots that stand where another beacon's should be are an exchange; other rejected spots
are glints (or the track's own fault, if there are many of all beacons).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from relnav.arrays import Codes, Flags, Matrix
from relnav.mission import Model
from relnav.navigation.record import Solution
from relnav.navigation.status import REJECTED
from relnav.sensors.three_beacon.psd import SlotStatus
from relnav.sensors.three_beacon.slots import Slots
from relnav.simulation.detector import photocurrents, project_beacons

LEAST_SLOTS = 20
"""Fewer slots of a beacon are no ground for a judgement."""
DEAD_SLOTS = 10
EXCHANGED_SHARE = 0.5
NEAR_M = 100e-6
"""Of a rejected spot to another beacon's place: ten times the noise."""
WEAK = 0.8
"""Of its own power at first: below, a beacon is said to lose power."""


@dataclass(frozen=True)
class BeaconHealth:
    """What a track says of one beacon.

    Attributes
    ----------
    name : str
        A, B or C.
    slots, rejected : int
        Slots in which it should have been seen, and spots that the filter refused.
    dead_since_s : float
        When it was last seen, if it was not seen in the last ten slots or more that should show it; else NaN.
    power_ratio : float
        Its current over the expected one in the last tenth of its slots, over that in the first; NaN if unknown.
    exchanged_with : str
        The beacon at whose place most of its rejected spots are; "" if there is none.
    glints : int
        Rejected spots at no other beacon's place.
    """

    name: str
    slots: int
    rejected: int
    dead_since_s: float
    power_ratio: float
    exchanged_with: str
    glints: int

    def findings(self) -> list[str]:
        """What is wrong, in words; empty if nothing is."""
        out = []
        if not math.isnan(self.dead_since_s):
            out.append(f"beacon {self.name} is dead since {self.dead_since_s:.6g} s")
        elif self.power_ratio < WEAK:
            out.append(f"beacon {self.name} has lost {100.0 * (1.0 - self.power_ratio):.0f} % of its power")
        if self.exchanged_with:
            first, second = sorted((self.name, self.exchanged_with))
            out.append(f"beacons {first} and {second} look exchanged in their slots")
        if self.glints > max(5.0, 0.01 * self.slots):
            out.append(f"beacon {self.name} has glints: {self.glints} of {self.slots} spots elsewhere")
        return out


def beacon_health(
    model: Model, slots: Slots, track: Solution, q_cam_from_lvlh: Matrix | None = None
) -> tuple[BeaconHealth, ...]:
    """Judge the three beacons by the slots of a raw log and the track that was made of them.

    Parameters
    ----------
    model, slots, track
        As they went into `filter_slots`, and what came of it.
    q_cam_from_lvlh : (n, 4), optional
        Camera attitude of each row; the model's if left out.
    """
    known = np.isfinite(track.state).sum(axis=1) == 6
    state = np.where(known[:, None], track.state, 0.0)
    dcm = None if q_cam_from_lvlh is None else Rotation.from_quat(q_cam_from_lvlh).as_matrix()
    places = project_beacons(model, state, dcm)
    half = 0.5 * np.array(model.sensor.detector_size_m)
    on = np.abs(places) <= half - NEAR_M
    in_view = on[..., 0] & on[..., 1] & known[:, None]
    expected = np.full(places.shape[:2], math.nan)
    if model.detector is not None and model.light is not None:
        expected = photocurrents(model, state, dcm) * model.detector.axis_share
    measured = model.corrected(slots.spots_m)
    out = []
    for beacon, name in enumerate("ABC"):
        rows = np.flatnonzero((slots.beacon == beacon) & in_view[:, beacon])
        lit = slots.status[rows] == int(SlotStatus.OK)
        refused = rows[lit & (track.status[rows] == REJECTED)]
        other, glints = _whose_places(measured[refused], places[refused], beacon)
        out.append(
            BeaconHealth(
                name=name,
                slots=len(rows),
                rejected=len(refused),
                dead_since_s=_dead_since(slots, beacon, rows, lit),
                power_ratio=_power_ratio(slots.current_a[rows[lit]] / expected[rows[lit], beacon]),
                exchanged_with=other if len(rows) >= LEAST_SLOTS else "",
                glints=glints,
            )
        )
    return tuple(out)


def _dead_since(slots: Slots, beacon: int, rows: Codes, lit: Flags) -> float:
    """Time of the beacon's last light, if the last ten slots or more that should show it do not."""
    if len(rows) < LEAST_SLOTS or lit[-DEAD_SLOTS:].any():
        return math.nan
    seen = np.flatnonzero((slots.beacon == beacon) & (slots.status == int(SlotStatus.OK)))
    return float(slots.t_s[seen[-1]]) if seen.size else float(slots.t_s[0])


def _power_ratio(ratio: Matrix) -> float:
    """Median of the last tenth over median of the first."""
    tenth = len(ratio) // 10
    if tenth < 2:
        return math.nan
    return float(np.median(ratio[-tenth:]) / np.median(ratio[:tenth]))


def _whose_places(spots: Matrix, places: Matrix, beacon: int) -> tuple[str, int]:
    """The other beacon near whose place most of these spots are ("" if none), and how many are near no other's."""
    near = np.linalg.norm(spots[:, None] - places, axis=-1) < NEAR_M
    near[:, beacon] = False
    glints = int((~near.any(axis=1)).sum())
    counts = near.sum(axis=0)
    best = int(np.argmax(counts))
    exchanged = len(spots) >= DEAD_SLOTS and counts[best] >= EXCHANGED_SHARE * len(spots)
    return ("ABC"[best] if exchanged else ""), glints


def findings(health: tuple[BeaconHealth, ...]) -> list[str]:
    """What is wrong with any of them, each said once."""
    return list(dict.fromkeys(finding for beacon in health for finding in beacon.findings()))
