"""One beacon at a time: the time code of slots, guard times and the dark slot, and what a lost step makes of it."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from relnav.arrays import Codes, Matrix, Vector

DARK = 3
"""Number of the dark slot; the beacons are 0, 1, 2."""
NAMES = ("a", "b", "c", "dark")


@dataclass(frozen=True)
class Pulses:
    """The time code: A, B, C in turn, then (if there is one) a slot with all beacons off.

    Attributes
    ----------
    slot_s : float
        Length of a slot.
    guard_s : float
        At the beginning and at the end of a slot nothing is sampled: beacons switch, currents settle.
    samples : int
        Converter samples averaged in a slot, spread evenly between the guards; one stands in the middle.
    dark_slot : bool
        Whether a cycle ends with a slot in which all beacons are off: background, and proof of being in step.
    dark_samples : int
        Converter samples averaged in a dark slot. The background of a cycle is the last dark slot's, so its noise is in
        all three spots: it wants many samples, and a mean over several cycles would not help a filter that averages
        longer than those.
    """

    slot_s: Annotated[float, Gt(0.0)]
    guard_s: Annotated[float, Ge(0.0)]
    samples: Annotated[int, Ge(1)] = 1
    dark_slot: bool = True
    dark_samples: Annotated[int, Ge(1)] = 64

    def __post_init__(self) -> None:
        if not self.guard_s < 0.5 * self.slot_s:
            raise ValueError(
                f"guard_s must be less than half of slot_s = {self.slot_s:g} s, else nothing is sampled; "
                f"got {self.guard_s:g} s"
            )

    @property
    def slots(self) -> int:
        """Slots of a cycle."""
        return 4 if self.dark_slot else 3

    @property
    def cycle_s(self) -> float:
        """Length of a cycle: every beacon is seen once in it."""
        return self.slots * self.slot_s

    def schedule(self, cycles: int) -> tuple[Vector, Codes]:
        """Middles of the slots (cycles * slots) s from the first one's, and which beacon each belongs to (3: dark)."""
        k = np.arange(cycles * self.slots)
        return k.astype(np.float64) * self.slot_s, k % self.slots

    def lit(self, late_s: float) -> Matrix:
        """Share of each slot's samples (slots,) that falls in each slot of the beacons (slots,): identity in step.

        late_s is how late the receiver samples by the beacons' clock. Up to `guard_s` nothing changes; beyond, a slot
        mixes two beacons; beyond half a slot it is the next beacon under this one's name.
        """
        open_s = self.slot_s - 2.0 * self.guard_s
        within = (np.arange(self.samples) + 0.5) / self.samples * open_s + self.guard_s  # from the slot's beginning
        share = np.zeros((self.slots, self.slots))
        for slot in range(self.slots):
            seen = np.floor((slot * self.slot_s + within + late_s) / self.slot_s).astype(int) % self.slots
            for k in seen:
                share[slot, k] += 1.0 / self.samples
        return share
