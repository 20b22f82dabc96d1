"""A star solution as plain values for a JSON file, and as a picture."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix
from relnav.files.images import Picture
from relnav.files.label_places import free_places
from relnav.files.picture_style import INK, QUIET, SERIES, check_picture, heading, new_figure, one_legend, save, styled
from relnav.files.star_pictures import Seen
from relnav.files.wording import printable
from relnav.geometry.rotation import quaternion_from_dcm
from relnav.sensors.dual_field.solution import StarLens, StarSolution

ARCSEC = 648000.0 / math.pi
ON_DARK = ("#56b4e9", "#f0a030", "#5fd0a5")
"""Of stars drawn over a picture, which is dark."""
MOST_DRAWN_PX = 1500
"""Pixels of a picture that are drawn along its longer side."""
RING_PT, NAME_PT, LETTER_PT = 5.0, 7.5, (5.0, 8.0)
"""Radius of a ring; size of a star's number, room for one of its letters."""
DRAWN_PT = np.array([640.0, 500.0])
"""Width and height of what is inside the axes."""


def solution_values(solution: StarSolution, spots_px: Matrix) -> dict[str, Any]:
    """The solution with its matched stars; null where there is no attitude."""
    values: dict[str, Any] = {"status": str(solution.status), "reason": solution.reason}
    ra, dec, roll = (math.degrees(angle) for angle in solution.ra_dec_roll_rad)
    values |= {"ra_deg": ra, "dec_deg": dec, "roll_deg": roll, "matches": solution.matches}
    values |= {
        "sigma_arcsec": (solution.sigma_rad * ARCSEC).tolist(),
        "matches_per_field": list(solution.matches_per_field),
        "focal_length_px": solution.focal_length_px,
        "residual_rms_arcsec": _rms(solution) * ARCSEC,
        "lens": _lens_values(solution.lens),
        "log10_false_alarm": solution.log10_false_alarm,
        "attitudes_tried": solution.tried,
        "dcm_cam_from_icrs": solution.dcm_cam_from_icrs.tolist(),
        "q_cam_from_icrs": quaternion_from_dcm(solution.dcm_cam_from_icrs).tolist() if solution.ok else None,
        "covariance_rad2": solution.covariance.tolist(),
        "stars": [
            {
                "spot": int(k),
                "x_px": float(spots_px[k, 0]),
                "y_px": float(spots_px[k, 1]),
                "hip": int(solution.hip[k]),
                "field": int(solution.field[k]),
                "residual_arcsec": float(solution.residual_rad[k] * ARCSEC),
            }
            for k in np.flatnonzero(solution.hip > 0)
        ],
    }
    return values


def _lens_values(lens: StarLens | None) -> dict[str, Any] | None:
    """The camera's constants; its attitude is that of the optical axis."""
    if lens is None:
        return None
    values = {"focal_length_px": lens.focal_length_px, "principal_point_px": list(lens.principal_point_px)}
    return values | {"distortion": list(lens.distortion), "dcm_from_icrs": lens.dcm_from_icrs.tolist()}


def _rms(solution: StarSolution) -> float:
    used = solution.residual_rad[np.isfinite(solution.residual_rad)]
    return float(np.sqrt(np.mean(used**2))) if used.size else math.nan


def draw_solution(solution: StarSolution, seen: Seen, title: str, path: Path) -> None:
    """Draw the spots, and which of them are which star, over the picture if there is one.

    Raises
    ------
    UsageError
        For another ending.
    """
    check_picture(path)
    with styled():
        figure = new_figure(10.0, 8.2)
        axis = figure.subplots()
        if seen.picture is not None:
            _draw_picture(axis, seen.picture)
        _draw_spots(axis, solution, seen)
        axis.set(xlabel="x_px (right)", ylabel="y_px (down)", aspect="equal")
        heading(figure, printable(title))
        one_legend(figure)
        save([figure], path)


def _draw_spots(axis: Any, solution: StarSolution, seen: Seen) -> None:
    """Rings about stars with their numbers, in colours that are seen on paper, or on the dark of a picture."""
    spots_px, on_picture = seen.frame.spots_px, seen.picture is not None
    colours = ON_DARK if on_picture else SERIES
    if (solution.hip == 0).any():
        axis.plot(*spots_px[solution.hip == 0].T, "x", color=QUIET, ms=6, label="spots without a star")
    fields = sorted({int(value) for value in solution.field if value >= 0})
    for field in fields:
        chosen, colour = solution.field == field, colours[field % len(colours)]
        label = f"stars of field {field}" if len(fields) > 1 else "stars"
        axis.plot(*spots_px[chosen].T, "o", mfc="none", ms=2.0 * RING_PT, color=colour, label=label)
    if left_out := _draw_names(axis, solution, seen, colours):
        axis.plot([], [], " ", label=f"({left_out} numbers found no room)")
    if on_picture:
        axis.grid(visible=False)
    else:
        axis.invert_yaxis()


def _draw_names(axis: Any, solution: StarSolution, seen: Seen, colours: Any) -> int:
    """The stars' numbers where they hide no spot and no other number; returns how many found no room."""
    spots_px, flux = seen.frame.spots_px, seen.frame.flux
    known = np.flatnonzero(solution.field >= 0)
    if flux is not None:
        known = known[np.argsort(-flux[known], kind="stable")]
    span = 1.1 * np.ptp(spots_px, axis=0) if seen.picture is None else np.array(seen.picture.size_px)
    points_a_px = float(np.min(DRAWN_PT / np.maximum(span, 1.0)))
    names = [f"HIP {solution.hip[k]}" for k in known]
    sizes = np.array([[LETTER_PT[0] * len(name), LETTER_PT[1]] for name in names]).reshape(-1, 2)
    edge = None if seen.picture is None else 0.5 * points_a_px * np.array(seen.picture.size_px)
    places = free_places(spots_px * np.array([1.0, -1.0]) * points_a_px, RING_PT, known.tolist(), sizes, edge)
    behind = {"facecolor": INK, "alpha": 0.75, "pad": 1.0, "lw": 0.0} if seen.picture is not None else None
    for k, name, place in zip(known, names, places, strict=True):
        if place is None:
            continue
        colour, (corner, led) = colours[solution.field[k] % len(colours)], place
        line = {"arrowstyle": "-", "color": colour, "lw": 0.5, "shrinkA": 0.0, "shrinkB": RING_PT} if led else None
        beside: Any = {"textcoords": "offset points", "fontsize": NAME_PT, "zorder": 1.5}  # below the rings
        axis.annotate(name, spots_px[k], corner, color=colour, bbox=behind, arrowprops=line, **beside)
    return places.count(None)


def _draw_picture(axis: Any, picture: Picture) -> None:
    """The picture in grey, dark stretched; of a large one the brightest pixel of every few, so that no star is lost."""
    width, height = picture.size_px
    step = max(1, max(width, height) // MOST_DRAWN_PX)
    part = picture.counts[: height // step * step, : width // step * step].astype(np.float32)
    shown = part.reshape(height // step, step, width // step, step).max(axis=(1, 3))
    low, high = np.nanpercentile(shown, [40.0, 99.9])
    edge = [-0.5 * width, 0.5 * width, 0.5 * height, -0.5 * height]
    axis.imshow(shown, cmap="gray", vmin=low, vmax=max(high, low + 1.0), extent=edge, interpolation="nearest")
