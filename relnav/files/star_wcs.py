"""A solved picture as a FITS header: world coordinates (TAN), with the lens's distortion as SIP polynomials.

Calabretta, Greisen (2002), "Representations of celestial coordinates in FITS"; Shupe et al. (2005), "The SIP convention
for representing distortion in FITS image headers". Both count pixels from 1: the first pixel's centre is (1, 1).
"""

from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.files.atomic import replacing
from relnav.files.images import require_astropy
from relnav.files.tables import relnav_version
from relnav.geometry.star_places import LIGHT_KM_S, aberration, radec
from relnav.sensors.dual_field.optics import project, rays
from relnav.sensors.dual_field.solution import StarLens
from relnav.sensors.dual_field.star_spots import picture_centre

FITS_FIRST_PIXEL = 1.0
INVERSE_ORDER, INVERSE_GRID = 5, 24
STEP_RAD = 1e-6


def wcs_cards(
    lens: StarLens, size_px: tuple[float, float], velocity_km_s: Vector | None = None, mirrored: bool = False
) -> dict[str, Any]:
    """Keywords of the header: where on the sky (ICRS catalogue places) each pixel of a picture looks.

    Parameters
    ----------
    lens : StarLens
        Camera and attitude.
    size_px : (2,)
        Width and height.
    velocity_km_s : (3,), optional
        Of the observer, where the attitude was found with aberration: it is taken out again.
    mirrored : bool
        The lens's y runs up the picture.

    Notes
    -----
    The lens's polynomial d (1 + k1 |d|^2 + k2 |d|^4) is one of SIP's, exactly, about the principal point. Only the
    inverse polynomials AP, BP are fitted, over the picture; readers that iterate do without them.
    """
    beta = np.zeros(3) if velocity_km_s is None else np.asarray(velocity_km_s) / LIGHT_KM_S
    up = np.array([1.0, -1.0 if mirrored else 1.0])
    place = picture_centre(size_px, FITS_FIRST_PIXEL) + up * lens.principal_point_px
    axis, slopes = _sky(lens, beta)
    ra, dec = radec(axis)
    cd = np.degrees(slopes) * up / lens.focal_length_px
    cards: dict[str, Any] = {"WCSAXES": 2, "CTYPE1": "RA---TAN", "CTYPE2": "DEC--TAN", "CUNIT1": "deg", "CUNIT2": "deg"}
    cards |= {"CRVAL1": float(np.degrees(ra)), "CRVAL2": float(np.degrees(dec))}
    cards |= {"CRPIX1": float(place[0]), "CRPIX2": float(place[1]), "RADESYS": "ICRS"}
    cards |= {f"CD{i + 1}_{j + 1}": float(cd[i, j]) for i in range(2) for j in range(2)}
    cards |= {"IMAGEW": round(size_px[0]), "IMAGEH": round(size_px[1])}
    if lens.distortion != (0.0, 0.0):
        cards |= {"CTYPE1": "RA---TAN-SIP", "CTYPE2": "DEC--TAN-SIP"} | _sip(lens, size_px)
    return cards


def write_wcs(cards: dict[str, Any], path: Path) -> None:
    """Write a FITS file of a header alone.

    Raises
    ------
    UsageError
        Without astropy.
    """
    require_astropy()
    from astropy.io import fits

    header = fits.Header([("SIMPLE", True), ("BITPIX", 8), ("NAXIS", 0), *cards.items()])
    header["HISTORY"] = f"relnav {relnav_version()}"
    with replacing(path, ".fits") as temporary:
        header.tofile(temporary)


def _sky(lens: StarLens, beta: Vector) -> tuple[Vector, Matrix]:
    """Catalogue place (3,) of the optical axis, and d(east, north)/d(x, y) (2, 2) there, on planes at distance 1."""

    def places(x: float, y: float) -> Vector:
        seen = np.array([[x, y, 1.0]]) @ lens.dcm_from_icrs
        place: Vector = aberration(seen / np.linalg.norm(seen), -beta)[0]
        return place

    axis = places(0.0, 0.0)
    ra, _ = radec(axis)
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    basis = np.stack([east, np.cross(axis, east)])
    ends = [
        [basis @ (v := places(*(sign * STEP_RAD * np.eye(2)[k]))) / (axis @ v) for sign in (1.0, -1.0)]
        for k in range(2)
    ]
    return axis, np.stack([(after - before) / (2.0 * STEP_RAD) for after, before in ends], axis=-1)


def _sip(lens: StarLens, size_px: tuple[float, float]) -> dict[str, Any]:
    """A, B from the lens's polynomial; AP, BP fitted to its inverse over the picture."""
    k1, k2 = lens.distortion[0] / lens.focal_length_px**2, lens.distortion[1] / lens.focal_length_px**4
    x_terms = {(3, 0): k1, (1, 2): k1}
    if k2:
        x_terms |= {(5, 0): k2, (3, 2): 2.0 * k2, (1, 4): k2}
    order = max(p + q for p, q in x_terms)
    cards: dict[str, Any] = {"A_ORDER": order, "B_ORDER": order, "AP_ORDER": INVERSE_ORDER, "BP_ORDER": INVERSE_ORDER}
    cards |= {f"A_{p}_{q}": value for (p, q), value in x_terms.items()}
    cards |= {f"B_{q}_{p}": value for (p, q), value in x_terms.items()}
    half = 0.5 * np.asarray(size_px) + np.abs(lens.principal_point_px)
    grid = np.stack(np.meshgrid(*(np.linspace(-side, side, INVERSE_GRID) for side in half)), axis=-1).reshape(-1, 2)
    scale = float(half.max())
    spot = project(rays(grid / lens.focal_length_px), lens.focal_length_px, (0.0, 0.0), lens.distortion)
    seen = np.isfinite(spot).all(axis=1)
    powers = [(p, q) for p in range(1, INVERSE_ORDER + 1, 2) for q in range(0, INVERSE_ORDER + 1 - p, 2)]
    at = grid[seen] / scale
    design = np.concatenate([np.stack([u**p * v**q for p, q in powers], axis=-1) for u, v in (at.T, at.T[::-1])])
    fitted = np.linalg.lstsq(design, (spot[seen] - grid[seen]).T.ravel(), rcond=None)[0]
    for (p, q), value in zip(powers, fitted, strict=True):
        cards[f"AP_{p}_{q}"] = cards[f"BP_{q}_{p}"] = float(value / scale ** (p + q))
    return cards
