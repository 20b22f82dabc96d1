"""Roll about the line of sight from a linearly polarised beacon: here the two rays do give a third axis.

Sunlight is unpolarised and its two spots share its light almost evenly. A beacon behind a polariser on the target puts
sin^2 into one ray and cos^2 into the other, whatever its distance and brightness: their ratio is the angle of its
polarisation, in axes of the crystal. With the line of sight from the places of the spots, that is the full relative
attitude up to the polarisation's own sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Vector, numbers
from relnav.sensors.birefringent_sun.crystal import mode_amplitudes
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor


@dataclass(frozen=True)
class PolarisedRoll:
    """Candidates for the angle of a beacon's polarisation.

    Attributes
    ----------
    psi_rad : (2,)
        Angles in [0, pi) from `polarisation_basis(s)`, counted about the line of sight. Two fit the ratio; each plus pi
        is the same light.
    sigma_rad : (2,)
        1-sigma of each from counting statistics alone.
    """

    psi_rad: Vector
    sigma_rad: Vector

    def nearest(self, prior_rad: float) -> tuple[float, float]:
        """The candidate (rad) nearest to a predicted angle, in the same revolution, and its 1-sigma."""
        off = np.remainder(self.psi_rad - prior_rad + 0.5 * np.pi, np.pi) - 0.5 * np.pi
        best = int(np.argmin(np.abs(off)))
        return prior_rad + float(off[best]), float(self.sigma_rad[best])


def shares(sensor: BirefringentSunSensor, s: Vector, psi_rad: float) -> Vector:
    """Shares (2,) of polarised light from s (3,) that enter as ordinary and extraordinary light."""
    amplitudes, _ = mode_amplitudes(s, sensor.axis, sensor.ordinary_index, sensor.extraordinary_index)
    parts: Vector = (amplitudes @ [np.cos(psi_rad), np.sin(psi_rad)]) ** 2
    return parts


def unpolarised_shares(sensor: BirefringentSunSensor, s: Vector) -> Vector:
    """Shares (2,) of sunlight from s (3,) that enter as ordinary and extraordinary light; the rest is reflected."""
    amplitudes, _ = mode_amplitudes(s, sensor.axis, sensor.ordinary_index, sensor.extraordinary_index)
    parts: Vector = 0.5 * np.sum(amplitudes**2, axis=1)
    return parts


def polarised_roll(sensor: BirefringentSunSensor, s: ArrayLike, photons_o: float, photons_e: float) -> PolarisedRoll:
    """Angle of a beacon's polarisation from the light in its two spots.

    Parameters
    ----------
    s : (3,)
        Line of sight to the beacon, unit vector in sensor axes, from the places of the spots.
    photons_o, photons_e : float
        Detected in the ordinary and extraordinary spot.

    Raises
    ------
    ValueError
        If s is no unit vector, or either is not above zero: then the angle is that of the empty ray, to the root of
        what went unseen.

    Notes
    -----
    With rho = sqrt(I_o / I_e): (A_1 cos + A_2 sin) = +-rho (B_1 cos + B_2 sin), A and B the amplitudes of the modes.
    sigma = sqrt(1/I_o + 1/I_e) / |d ln(I_o / I_e) / d psi|, which is 1 / (2 sqrt N) for a lossless crystal on axis.
    """
    if not (photons_o > 0.0 and photons_e > 0.0):
        raise ValueError(f"both spots must have light; got {photons_o} and {photons_e} photons")
    sight = numbers("s", s)
    if sight.shape != (3,) or not abs(float(np.linalg.norm(sight)) - 1.0) < 1e-6:
        raise ValueError(f"s: a unit vector (3,) in sensor axes is expected; got {sight.tolist()}")
    A, B = mode_amplitudes(sight, sensor.axis, sensor.ordinary_index, sensor.extraordinary_index)[0]
    rho = np.sqrt(photons_o / photons_e)
    psi, sigma = np.empty(2), np.empty(2)
    for k, sign in enumerate((1.0, -1.0)):
        mixed = A - sign * rho * B
        psi[k] = np.remainder(np.arctan2(-mixed[0], mixed[1]), np.pi)
        field, slope = np.array([np.cos(psi[k]), np.sin(psi[k])]), np.array([-np.sin(psi[k]), np.cos(psi[k])])
        rate = 2.0 * ((A @ slope) / (A @ field) - (B @ slope) / (B @ field))
        sigma[k] = np.sqrt(1.0 / photons_o + 1.0 / photons_e) / abs(rate)
    return PolarisedRoll(psi, sigma)
