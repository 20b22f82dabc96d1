"""Draw the figures of the documentation: python docs/figures.py [FOLDER]. A test holds what they show."""

import sys
from pathlib import Path

import numpy as np

import relnav
from relnav.files.picture_style import ESTIMATE, PUBLISHED, QUIET, named_line, new_figure, one_legend, save, styled

RANGE_M, OFF_AXIS_DEG = 6.5, 5.0
FLOWS = (
    *((name, "measure") for name in ("beacons", "markers", "stars", "sun")),
    *(("gyro, thrusters", "navigator"), ("measure", "navigator"), ("navigator", "solution"), ("navigator", "control")),
    *(("solution", "files, pictures,"), ("solution", "accuracy"), ("control", "gyro, thrusters")),
)


def spots_of(model, range_m: float, azimuth_deg: float, elevation_deg: float = 0.0) -> np.ndarray:
    """Spots (3, 2) m on the detector of a camera that points at O, its x axis level."""
    az, el = np.radians([azimuth_deg, elevation_deg])
    place = range_m * np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), -np.sin(el)])
    boresight = -place / range_m
    right = np.cross([0.0, 0.0, 1.0], boresight)
    right /= np.linalg.norm(right)
    seen = (model.sensor.beacons_dock_m - place) @ np.array([right, np.cross(boresight, right), boresight]).T
    return model.sensor.focal_length_m * seen[:, :2] / seen[:, 2:]


def printed_error_deg(range_m: float) -> float:
    """What the paper's closed form reads too much in azimuth, OFF_AXIS_DEG off the axis, without noise."""
    printed = relnav.load_model("three_beacon_psd", {"projection": "parallel", "detector_size_mm": [80.0, 80.0]})
    fix = relnav.three_beacon.measure(spots_of(printed, range_m, OFF_AXIS_DEG), printed)
    return float(np.degrees(fix.azimuth_rad)) - OFF_AXIS_DEG


def _triangle(figure) -> None:
    axes, model = figure.subplots(), relnav.load_model("three_beacon_psd")
    for az, el, colour, width, label in (
        (0.0, 0.0, QUIET, 6.0, "on the axis"),
        (5.0, 0.0, ESTIMATE, 3.5, "azimuth 5 deg"),
        (0.0, 5.0, PUBLISHED, 1.5, "elevation 5 deg"),
    ):
        spots = 1e3 * spots_of(model, RANGE_M, az, el)
        axes.plot(*spots[[0, 1, 2, 0]].T, "o-", color=colour, lw=width, ms=5 + width, label=label)
    for name, spot in zip("ABC", 1e3 * spots_of(model, RANGE_M, 0.0, 0.0), strict=True):
        axes.annotate(name, spot, textcoords="offset points", xytext=(6, 6))
    axes.set(xlim=(-4, 4), ylim=(1.0, -1.0), xlabel="detector x, mm", ylabel="y, mm (down)", aspect="equal")
    one_legend(figure)


def _printed(figure) -> None:
    axes, ranges = figure.subplots(), np.linspace(2.0, 10.0, 33)
    axes.plot(ranges, [printed_error_deg(r) for r in ranges], color=ESTIMATE, label="printed form, without noise")
    named_line(axes, 0.176, "published accuracy, 0.176 deg")
    axes.set(xlabel="range, m", ylabel="azimuth read too much, deg", ylim=(0.0, None))
    one_legend(figure)


def _whole(figure) -> None:
    axes = figure.subplots()
    boxes = {
        "beacons\nspots of a PSD": (0.0, 4.0), "markers\nspots of a camera": (0.0, 3.0),
        "stars\npictures or spots": (0.0, 2.0), "sun\nimages or spots": (0.0, 1.0), "gyro, thrusters": (0.0, 0.0),
        "measure\none image: value,\ncovariance, status": (1.0, 2.5),
        "navigator\nimages + motion:\nstate, covariance": (2.0, 2.5),
        "solution\na whole log,\nsmoothed": (3.0, 3.4), "control\nyours": (3.0, 1.6),
        "files, pictures,\nreport page": (4.0, 3.9), "accuracy\nagainst truth\nand the papers": (4.0, 2.9),
    }  # fmt: skip
    drawn = {}
    for text, place in boxes.items():
        name = text.split("\n")[0]
        filled = "#ffffff" if name == "control" else "#e8f0f8"
        style = {"boxstyle": "round,pad=0.5", "facecolor": filled, "edgecolor": ESTIMATE}
        drawn[name] = place, axes.text(*place, text, ha="center", va="center", fontsize=9, bbox=style)
    axes.set(xlim=(-0.5, 4.5), ylim=(-0.5, 4.5))
    axes.axis("off")
    figure.canvas.draw()  # where a box ends is known once it is drawn
    for names in FLOWS:
        (start, one), (end, other) = drawn[names[0]], drawn[names[1]]
        ends = {"patchA": one.get_bbox_patch(), "patchB": other.get_bbox_patch(), "shrinkA": 3, "shrinkB": 3}
        axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": QUIET, "lw": 1.3, **ends})


FIGURES = {"triangle": (_triangle, (7.0, 2.6)), "printed_form": (_printed, (6.0, 3.2)), "whole": (_whole, (9.0, 4.4))}


def draw(folder: Path) -> None:
    """Write every figure of `FIGURES` as PNG."""
    for name, (make, size) in FIGURES.items():
        with styled():
            figure = new_figure(*size)
            make(figure)
            save([figure], folder / ("theory" if name != "whole" else ".") / f"{name}.png")


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
