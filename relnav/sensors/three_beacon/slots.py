"""From the currents of single slots to spots with their noise, each at its own time; or joined into whole images."""

import math
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.sensors.three_beacon.psd import (
    Detector,
    SlotStatus,
    slot_status,
    spot_sigma,
    spots_of_currents,
)
from relnav.sensors.three_beacon.pulses import DARK, Pulses


@dataclass(frozen=True)
class Slots:
    """Spots of a raw log, one entry a slot.

    Attributes
    ----------
    t_s, beacon : (n,), (n,)
        Time of the slot, and its beacon: 0, 1, 2, or 3 for the dark slot.
    spots_m, sigma_m : (n, 2), (n, 2)
        Where its spot is, not yet calibrated, and its noise, 1-sigma; NaN unless `status` is OK.
    current_a : (n,)
        Sum of an axis, mean of both, background subtracted.
    status : (n,)
        `SlotStatus`; a dark slot is OK, and has no spot.
    """

    t_s: Vector
    beacon: Codes
    spots_m: Matrix
    sigma_m: Matrix
    current_a: Vector
    status: Codes

    def epochs(self) -> tuple[Stack, Stack]:
        """Spots and sigmas (n, 3, 2) with one beacon a row: each spot enters a filter at its own time."""
        spots, sigma = np.full((len(self.t_s), 3, 2), np.nan), np.full((len(self.t_s), 3, 2), np.nan)
        lit = np.flatnonzero(self.beacon != DARK)
        spots[lit, self.beacon[lit]] = self.spots_m[lit]
        sigma[lit, self.beacon[lit]] = self.sigma_m[lit]
        return spots, sigma

    def images(self) -> tuple[Stack, Stack]:
        """Spots and sigmas (n, 3, 2) joined into one image a cycle, at the rows of beacon C; the other rows hold none.

        The other beacons' spots are taken between their slots before and after that time: steady motion does no harm.
        Every slot is used in two images, with weights that sum to one: sigma is that of one slot, so that a filter
        does not count it twice. Where one of the two is missing the beacon is missing.
        """
        spots, sigma = self.epochs()
        rows = np.flatnonzero(self.beacon == 2)
        images, sigmas = np.full_like(spots, np.nan), np.full_like(sigma, np.nan)
        images[rows, 2], sigmas[rows, 2] = spots[rows, 2], sigma[rows, 2]
        for beacon in range(2):
            own = np.flatnonzero(self.beacon == beacon)
            after = np.searchsorted(own, rows)
            inside = (after > 0) & (after < len(own))
            here, before, after = rows[inside], own[after[inside] - 1], own[after[inside]]
            weight = ((self.t_s[here] - self.t_s[before]) / (self.t_s[after] - self.t_s[before]))[:, None]
            images[here, beacon] = (1.0 - weight) * self.spots_m[before] + weight * self.spots_m[after]
            sigmas[here, beacon] = np.maximum(self.sigma_m[before], self.sigma_m[after])
        return images, sigmas

    def simultaneous(self) -> tuple[Stack, Stack]:
        """As `images`, but as if a cycle's spots had been seen at one time, that of B's row: what timing is worth."""
        spots, sigma = self.epochs()
        rows = np.flatnonzero(self.beacon == 1)
        images, sigmas = np.full_like(spots, np.nan), np.full_like(sigma, np.nan)
        for beacon, shift in ((0, -1), (1, 0), (2, 1)):
            inside = (rows + shift >= 0) & (rows + shift < len(spots))
            here, at = rows[inside], rows[inside] + shift
            images[here, beacon], sigmas[here, beacon] = spots[at, beacon], sigma[at, beacon]
        return images, sigmas


def read_slots(
    detector: Detector,
    pulses: Pulses,
    size_m: tuple[float, float],
    t_s: Vector,
    beacon: Codes,
    currents_a: Matrix,
) -> Slots:
    """Spots, noise and status of raw slots.

    Parameters
    ----------
    detector, pulses, size_m
        What was built; full width and height of the detector.
    t_s, beacon, currents_a : (n,), (n,), (n, 4)
        Times, beacons (3: dark), currents of x1, x2, y1, y2; NaN = missing, inf = saturated.
    """
    dark = _background(beacon, currents_a)
    status = slot_status(detector, currents_a, dark)
    lit = beacon != DARK
    status[~lit & (status == int(SlotStatus.UNDER_RANGE))] = int(SlotStatus.OK)  # as a dark slot should be
    known = (status == int(SlotStatus.OK)) | (status == int(SlotStatus.UNDER_RANGE))
    status[known & _out_of_step(detector, beacon, currents_a)] = int(SlotStatus.OUT_OF_STEP)
    usable = lit & (status == int(SlotStatus.OK))
    spots, sigma = np.full((len(t_s), 2), np.nan), np.full((len(t_s), 2), np.nan)
    with np.errstate(invalid="ignore"):
        signal = currents_a - dark
    spots[usable], total = spots_of_currents(size_m, signal[usable])
    off = usable.copy()
    off[usable] = (np.abs(spots[usable]) > 0.5 * np.asarray(size_m)).any(axis=1)
    status[off] = int(SlotStatus.UNDER_RANGE)  # noise alone can put it there
    spots[off] = np.nan
    sigma[usable] = spot_sigma(
        detector,
        size_m,
        spots[usable],
        total.mean(axis=1),
        dark[usable].mean(axis=1),
        samples=pulses.samples,
        dark_samples=pulses.dark_samples if (beacon == DARK).any() else math.inf,
    )
    with np.errstate(invalid="ignore"):
        current = 0.5 * signal.sum(axis=1)
    return Slots(t_s, beacon, spots, sigma, current, status)


def _background(beacon: Codes, currents_a: Matrix) -> Matrix:
    """Currents (n, 4) of the last whole dark slot before each row; before the first, that one; zero without any."""
    rows = np.flatnonzero((beacon == DARK) & np.isfinite(currents_a).all(axis=1))
    if rows.size == 0:
        return np.zeros_like(currents_a)
    last = np.maximum(np.searchsorted(rows, np.arange(len(beacon))) - 1, 0)
    background: Matrix = currents_a[rows[last]]
    return background


def _out_of_step(detector: Detector, beacon: Codes, currents_a: Matrix) -> Flags:
    """Rows whose cycle's dark slot is brighter than one of its lit slots: some beacon shines where none should."""
    out = np.zeros(len(beacon), dtype=bool)
    rows = np.flatnonzero(beacon == DARK)
    with np.errstate(invalid="ignore"):
        total = 0.5 * currents_a.sum(axis=1)
        begin = 0
        for end in rows.tolist():
            cycle = slice(begin, end + 1)
            if (total[cycle] < total[end] - detector.least_current_a).any():
                out[cycle] = True
            begin = end + 1
    return out
