"""The two-axis lateral-effect detector as an instrument: four photocurrents to a spot, and the noise of both.

Each axis has two electrodes that share the axis' current in proportion to where the spot is (section 2 of
Cai, Zhao, Sun, Qiao, Dai (1996), "Determination of target relative position and range by PSD optical sensor system"):

    x = (L / 2) (I2 - I1) / (I1 + I2),        the sum I1 + I2 = S carries the intensity only.

To first order dx = (L / S^2) (I1 dI2 - I2 dI1), so that noise of both electrodes alike cancels in the middle, and
noise that leaves one electrode by the other (the thermal current of the layer between them) counts twice. Currents
are in amperes, electrodes in the order x1, x2, y1, y2: x2 is the one at +x (right), y2 the one at +y (down).
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from relnav.arrays import Codes, Matrix, Vector

Positive = Annotated[float, Gt(0.0)]
NonNegative = Annotated[float, Ge(0.0)]

ELEMENTARY_CHARGE_C = 1.602176634e-19  # exact, SI brochure (2019)
BOLTZMANN_J_K = 1.380649e-23  # exact, SI brochure (2019)
ROOM_K = 293.0


class SlotStatus(IntEnum):
    """What became of one slot of a raw log."""

    OK = 0
    MISSING = 1
    """A current is not there (empty, NaN)."""
    UNDER_RANGE = 2
    """An axis' sum is too small for a beacon: off, hidden, or off the detector."""
    SATURATED = 3
    """A current is at the converter's end, or more than the detector is linear to."""
    OUT_OF_STEP = 4
    """The dark slot was not dark: beacons and receiver have lost step, and nobody knows which beacon this is."""


@dataclass(frozen=True)
class Detector:
    """A position-sensitive detector with its amplifiers and converter.

    Attributes
    ----------
    electrodes : {"tetra_lateral", "duo_lateral"}
        Whether the four electrodes share the photocurrent (half of it on each axis), or each axis carries all of it.
    responsivity_a_w : float
        Photocurrent over light power.
    interelectrode_resistance_ohm : float
        Between the two electrodes of an axis: its thermal current flows out of one into the other.
    amplifier_noise_a_sqrt_hz : float
        Current noise density at the input of each amplifier.
    bandwidth_hz : float
        3 dB bandwidth; a single pole lets pass the noise of pi / 2 times it.
    feedback_resistance_ohm : float
        I/U conversion: U = R I.
    adc_full_scale_v, adc_bits : float, int
        Range of the converter, from 0 V, and its resolution.
    saturation_current_a : float
        Photocurrent beyond which the detector is not linear.
    least_current_a : float
        Sum of an axis below which no beacon is believed.
    """

    electrodes: Literal["tetra_lateral", "duo_lateral"]
    responsivity_a_w: Positive
    interelectrode_resistance_ohm: Positive
    amplifier_noise_a_sqrt_hz: NonNegative
    bandwidth_hz: Positive
    feedback_resistance_ohm: Positive
    adc_full_scale_v: Positive
    adc_bits: Annotated[int, Ge(1), Le(32)]
    saturation_current_a: Positive
    least_current_a: Positive

    @property
    def axis_share(self) -> float:
        """Part of the photocurrent that one axis' pair of electrodes carries."""
        return 0.5 if self.electrodes == "tetra_lateral" else 1.0

    @property
    def noise_bandwidth_hz(self) -> float:
        """Bandwidth of white noise that a single pole lets pass."""
        return 0.5 * math.pi * self.bandwidth_hz

    @property
    def current_per_count_a(self) -> float:
        """Least step of the converter, as a current."""
        return float(self.adc_full_scale_v / 2**self.adc_bits / self.feedback_resistance_ohm)

    @property
    def thermal_variance_a2(self) -> float:
        """4 k T B / R of the layer between two electrodes, A^2."""
        return 4.0 * BOLTZMANN_J_K * ROOM_K * self.noise_bandwidth_hz / self.interelectrode_resistance_ohm

    def electrode_variance_a2(self, current_a: Vector) -> Vector:
        """Noise of single electrodes at these mean currents, A^2: shot 2 e I B, amplifier, converter.

        Shot noise is taken as independent between electrodes, as manufacturers do: signal carriers that split in a
        fixed ratio would be quieter in the middle, so this is the careful side.
        """
        shot = 2.0 * ELEMENTARY_CHARGE_C * np.abs(current_a) * self.noise_bandwidth_hz
        steady = self.amplifier_noise_a_sqrt_hz**2 * self.noise_bandwidth_hz + self.current_per_count_a**2 / 12.0
        variance: Vector = shot + steady
        return variance


def currents_of_spots(
    detector: Detector, size_m: tuple[float, float], spots_m: Matrix, photocurrent_a: Vector
) -> Matrix:
    """Mean currents (..., 4) of light spots at (..., 2) m on a detector of this size, photocurrent (...) A each."""
    half = 0.5 * np.asarray(size_m)
    share = 0.5 * detector.axis_share * photocurrent_a[..., None]
    ratio = spots_m / half
    return np.stack([share * (1.0 - ratio), share * (1.0 + ratio)], axis=-1).reshape(*spots_m.shape[:-1], 4)


def spots_of_currents(size_m: tuple[float, float], currents_a: Matrix) -> tuple[Matrix, Matrix]:
    """Difference over sum of each axis: spots (..., 2) m and the axes' sums (..., 2) A of currents (..., 4)."""
    pairs = np.asarray(currents_a).reshape(*currents_a.shape[:-1], 2, 2)
    total = pairs[..., 0] + pairs[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        spots = 0.5 * np.asarray(size_m) * (pairs[..., 1] - pairs[..., 0]) / total
    return spots, total


def spot_sigma(
    detector: Detector,
    size_m: tuple[float, float],
    spots_m: Matrix,
    axis_current_a: Vector,
    background_a: Vector | float = 0.0,
    *,
    samples: int = 1,
    dark_samples: float = math.inf,
) -> Matrix:
    """1-sigma (..., 2) m of spots that were computed from background-free currents.

    The covariance of a spot is the diagonal of the squares: noise of the x pair does not reach the y pair.

    Parameters
    ----------
    detector, size_m
        Detector and its full width and height.
    spots_m : (..., 2)
        Where the spot is, m.
    axis_current_a : (...)
        Sum of one axis without background (the signal S), A.
    background_a : (...) or float
        Current of the background on each electrode, A: subtracted, but its shot noise stays.
    samples : int
        Converter samples averaged into each current; independent if they are further apart than the rise time.
    dark_samples : float
        Samples averaged into the background that was subtracted; inf: it is known.
    """
    ratio = spots_m / (0.5 * np.asarray(size_m))
    s = np.asarray(axis_current_a)[..., None]
    background = np.broadcast_to(np.asarray(background_a, dtype=np.float64), np.shape(axis_current_a))[..., None]
    variance = np.zeros(np.shape(spots_m))
    for sign in (-1.0, 1.0):  # of the electrode; the other one's share weighs its noise
        own, other = 0.5 * s * (1.0 + sign * ratio), 0.5 * (1.0 - sign * ratio)
        lit = detector.electrode_variance_a2(own + background) / samples
        dark = detector.electrode_variance_a2(background) / dark_samples
        variance += other**2 * (lit + dark)
    variance += detector.thermal_variance_a2 * (1.0 / samples + 1.0 / dark_samples)
    with np.errstate(divide="ignore"):
        return np.asarray(size_m) * np.sqrt(variance) / s


def noisy_currents(detector: Detector, currents_a: Matrix, rng: np.random.Generator) -> Matrix:
    """One sample of currents (..., 4) A with shot, amplifier and thermal noise; no converter yet."""
    step = detector.current_per_count_a**2 / 12.0
    own = np.sqrt(detector.electrode_variance_a2(currents_a) - step)
    through = rng.normal(size=(*currents_a.shape[:-1], 2)) * math.sqrt(detector.thermal_variance_a2)
    flow = np.stack([-through, through], axis=-1).reshape(currents_a.shape)
    return currents_a + own * rng.normal(size=currents_a.shape) + flow


def counts_of_currents(detector: Detector, currents_a: Matrix) -> Matrix:
    """Converter output (..., 4) of currents: whole numbers within 0 .. 2^bits - 1."""
    counts = np.floor(np.asarray(currents_a) / detector.current_per_count_a)
    return np.clip(counts, 0.0, 2.0**detector.adc_bits - 1.0)


def currents_of_counts(detector: Detector, counts: Matrix) -> Matrix:
    """Currents (..., 4) A that converter counts stand for: the middle of each step; the last is inf, saturated."""
    currents = (np.asarray(counts, dtype=np.float64) + 0.5) * detector.current_per_count_a
    return np.where(np.asarray(counts) >= 2.0**detector.adc_bits - 1.0, np.inf, currents)


def slot_status(detector: Detector, currents_a: Matrix, background_a: Matrix) -> Codes:
    """`SlotStatus` of raw currents (..., 4), background (..., 4) of the dark slot beside them (not yet subtracted)."""
    _, total = spots_of_currents((1.0, 1.0), currents_a - background_a)
    full = detector.adc_full_scale_v / detector.feedback_resistance_ohm - detector.current_per_count_a
    status = np.full(total.shape[:-1], int(SlotStatus.OK), dtype=np.int64)
    with np.errstate(invalid="ignore"):
        dim = (total < detector.least_current_a).any(axis=-1)
        linear = 2.0 * detector.axis_share * detector.saturation_current_a  # limit of the four currents together
        bright = (currents_a >= full).any(axis=-1) | (currents_a.sum(axis=-1) > linear)
    status[dim] = int(SlotStatus.UNDER_RANGE)
    status[bright] = int(SlotStatus.SATURATED)
    status[np.isnan(currents_a).any(axis=-1)] = int(SlotStatus.MISSING)
    return status
