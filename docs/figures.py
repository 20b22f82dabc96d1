"""Draw the figures of the documentation: python docs/figures.py [FOLDER]. A test holds what they show."""

import sys
from pathlib import Path

import numpy as np

import relnav

RANGE_M, OFF_AXIS_DEG = 6.5, 5.0


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


def _triangle(axes) -> None:
    model = relnav.load_model("three_beacon_psd")
    for az, el, colour, label in ((0.0, 0.0, "#888888", "on the axis"), (5.0, 0.0, "#1f6fb4", "azimuth 5 deg"),
                                  (0.0, 5.0, "#c0392b", "elevation 5 deg")):  # fmt: skip
        spots = 1e3 * spots_of(model, RANGE_M, az, el)
        axes.plot(*spots[[0, 1, 2, 0]].T, "o-", color=colour, label=label)
    for name, spot in zip("ABC", 1e3 * spots_of(model, RANGE_M, 0.0, 0.0), strict=True):
        axes.annotate(name, spot, textcoords="offset points", xytext=(4, 6))
    axes.set(xlim=(-4, 4), ylim=(1.0, -1.0), xlabel="detector x, mm", ylabel="y, mm (down)", aspect="equal")
    axes.legend(fontsize=8, loc="lower right", ncols=3)


def _printed(axes) -> None:
    ranges = np.linspace(2.0, 10.0, 33)
    axes.plot(ranges, [printed_error_deg(r) for r in ranges], color="#c0392b", label="printed form, without noise")
    axes.axhline(0.176, color="#888888", linestyle="--", label="published accuracy, 0.176 deg")
    axes.set(xlabel="range, m", ylabel="azimuth read too much, deg", ylim=(0.0, None))
    axes.legend(fontsize=8)


def _whole(axes) -> None:
    boxes = {
        "beacons\nspots of a PSD": (0.0, 4.0), "markers\nspots of a camera": (0.0, 3.0),
        "stars\npictures or spots": (0.0, 2.0), "sun\nimages or spots": (0.0, 1.0), "gyro, thrusters": (0.0, 0.0),
        "measure\none image: value,\ncovariance, status": (1.0, 2.5),
        "navigator\nimages + motion:\nstate, covariance": (2.0, 2.5),
        "solution\na whole log,\nsmoothed": (3.0, 3.4), "control\nyours": (3.0, 1.6),
        "files, pictures,\nreport page": (4.0, 3.9), "accuracy\nagainst truth\nand the papers": (4.0, 2.9),
    }  # fmt: skip
    for text, place in boxes.items():
        mine = not text.startswith("control")
        style = {"boxstyle": "round,pad=0.4", "facecolor": "#e8f0f8" if mine else "#ffffff", "edgecolor": "#1f6fb4"}
        axes.text(*place, text, ha="center", va="center", fontsize=8, bbox=style)
    lines = [((0.33, y), (0.68, 2.5)) for y in (4.0, 3.0, 2.0, 1.0)] + [((0.3, 0.0), (1.7, 2.1))]
    lines += [((1.33, 2.5), (1.68, 2.5)), ((2.33, 2.6), (2.72, 3.3)), ((2.33, 2.4), (2.75, 1.7))]
    lines += [((3.25, 3.5), (3.65, 3.9)), ((3.25, 3.3), (3.66, 3.0)), ((2.9, 1.3), (0.3, -0.1))]
    for start, end in lines:
        axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": "#555555"})
    axes.set(xlim=(-0.5, 4.5), ylim=(-0.6, 4.6))
    axes.axis("off")


FIGURES = {"triangle": (_triangle, (7.0, 2.6)), "printed_form": (_printed, (6.0, 3.2)), "whole": (_whole, (9.0, 4.2))}


def draw(folder: Path) -> None:
    """Write every figure of `FIGURES` as PNG."""
    from matplotlib.figure import Figure

    for name, (make, size) in FIGURES.items():
        figure = Figure(figsize=size, layout="constrained")
        make(figure.subplots())
        place = "theory" if name != "whole" else "."
        figure.savefig(folder / place / f"{name}.png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
