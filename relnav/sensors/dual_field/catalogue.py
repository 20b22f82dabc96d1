"""The star catalogue as arrays, and where its stars stand at an epoch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from relnav.arrays import Matrix, Vector
from relnav.geometry.star_places import LIGHT_KM_S, aberration, parallax, space_motion

HIPPARCOS_EPOCH_JYEAR = 1991.25


@dataclass(frozen=True, eq=False)
class StarCatalogue:
    """Stars, brightest first, ICRS at J1991.25.

    Attributes
    ----------
    hip : (n,)
        Hipparcos numbers.
    ra_rad, dec_rad, parallax_mas, pm_ra_cos_dec_mas_yr, pm_dec_mas_yr, hp_mag : (n,)
        Place, parallax, proper motion, magnitude in the Hipparcos passband.
    """

    hip: NDArray[np.int32]
    ra_rad: Vector
    dec_rad: Vector
    parallax_mas: Vector
    pm_ra_cos_dec_mas_yr: Vector
    pm_dec_mas_yr: Vector
    hp_mag: Vector

    def __len__(self) -> int:
        return len(self.hip)

    def directions(
        self,
        epoch_jyear: float,
        *,
        velocity_km_s: ArrayLike | None = None,
        position_au: ArrayLike | None = None,
        stars: slice = slice(None),
    ) -> Matrix:
        """Unit vectors (n, 3) at an epoch, ICRS.

        Parameters
        ----------
        epoch_jyear : float
            Julian year (2026.5), TDB; proper motion is carried there.
        velocity_km_s : (3,), optional
            Observer's barycentric velocity, ICRS: the apparent directions, with aberration.
        position_au : (3,), optional
            Observer's barycentric position: with parallax (0.8 arcsec at most).
        stars : slice
            Part of the catalogue.
        """
        u = space_motion(
            self.ra_rad[stars],
            self.dec_rad[stars],
            self.pm_ra_cos_dec_mas_yr[stars],
            self.pm_dec_mas_yr[stars],
            epoch_jyear - HIPPARCOS_EPOCH_JYEAR,
        )
        if position_au is not None:
            u = parallax(u, self.parallax_mas[stars], np.asarray(position_au, dtype=np.float64))
        if velocity_km_s is not None:
            u = aberration(u, np.asarray(velocity_km_s, dtype=np.float64) / LIGHT_KM_S)
        return u
