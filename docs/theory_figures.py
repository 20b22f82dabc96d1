"""Draw the theory pages' figures, one for a system: python docs/theory_figures.py [FOLDER].

Each figure keeps what it shows as numbers in its own PNG (`NUMBERS`); a test computes them anew and compares, so that a
figure that the program no longer draws is found.
"""

import json
import sys
from io import BytesIO
from pathlib import Path

import numpy as np

import relnav
from relnav.accuracy.campaign import Way, run_campaign
from relnav.accuracy.three_marker_trials import scaled_orthography_errors, small_angle_errors
from relnav.estimation.consistency import chi_square_interval
from relnav.files.picture_style import (
    DOTS_AN_INCH,
    ESTIMATE,
    GATE,
    INK,
    PUBLISHED,
    QUIET,
    SPREAD,
    new_figure,
    plain_decades,
    styled,
)
from relnav.geometry.projection_angles import direction_from_angles
from relnav.geometry.wahba import solve_wahba
from relnav.sensors.aps_sun.patent import fit_patent, patent_angles, stage_one_angles
from relnav.sensors.aps_sun.rays import pinhole_angles, project
from relnav.sensors.birefringent_sun.spots import spots_of_transverse
from relnav.sensors.dual_field.prediction import attitude_sigma
from relnav.simulation.trajectory import Approach

NUMBERS = "relnav numbers"
STARS, FIELD_DEG, SKIES = 13, 14.0, 40
RUNS = 20
ARCSEC = np.radians(1.0 / 3600.0)


def _two_fields(figure) -> None:
    """Spread of the three angles over the angle between two fields, from the stars' covariance in random skies."""
    camera = relnav.load_model("dual_field_star").camera
    noise, half = camera.spot_noise_px / camera.focal_length_px, np.radians(0.5 * FIELD_DEG)
    rng = np.random.default_rng(1)
    z = 1.0 - rng.random((SKIES, 2, STARS)) * (1.0 - np.cos(half))
    around, r = 2.0 * np.pi * rng.random(z.shape), np.sqrt(1.0 - z**2)
    caps = np.stack([r * np.cos(around), r * np.sin(around), z], axis=-1)
    between = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0])
    between = np.concatenate([between, [90.0], 180.0 - between[::-1]])
    sigma = []
    for angle in np.radians(between):
        turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        stars = np.concatenate([caps[:, 0], caps[:, 1] @ turn.T], axis=1)
        variance = np.mean([np.diagonal(solve_wahba(w, w, noise).covariance) for w in stars], axis=0)
        sigma.append(np.sqrt(variance) / ARCSEC)
    axes = figure.subplots()
    names = ("pitch, about x", "yaw, about y", "roll, about z: the first field's boresight")
    for values, name, colour in zip(np.transpose(sigma), names, (SPREAD, ESTIMATE, GATE), strict=True):
        axes.semilogy(between, values, color=colour, label=name)
    right = attitude_sigma(STARS, STARS, 2.0 * half, noise) / ARCSEC
    axes.plot([90.0] * 3, right, "o", color=INK, ms=4, label="closed form at 90 deg")
    axes.set(xlabel="angle between the fields, deg", ylabel="1-sigma, arcsec", xlim=(0, 180), xticks=range(0, 181, 30))
    axes.set_yticks([0.3, 0.5, 1.0, 2.0, 4.0], ["0.3", "0.5", "1", "2", "4"])
    axes.set_yticks([], minor=True)


def _compensation(figure) -> None:
    """Error of a plain hole and what each stage of the patent leaves, along alpha at beta = 20 deg, without noise."""
    model = relnav.load_model("aps_sun")
    whole = np.radians(np.arange(-60.0, 61.0))
    grid = np.stack(np.meshgrid(whole, whole, indexing="ij"), axis=-1).reshape(-1, 2)
    spots = project(model, direction_from_angles(*grid.T))
    angle = np.linspace(0.25, 59.75, 120)
    true = np.radians(np.column_stack([angle, np.full_like(angle, 20.0)]))
    seen = project(model, direction_from_angles(*true.T))
    optical = fit_patent(spots, *grid.T)
    mechanical = fit_patent(spots, *grid.T, h_px=model.sensor.hole_height_m / model.sensor.pixel_pitch_m)
    curves = {
        "plain hole": (pinhole_angles(model, seen), GATE),
        "stage one, optical h": (stage_one_angles(optical, seen), QUIET),
        "both stages, h as the text has it": (patent_angles(mechanical, seen)[0], PUBLISHED),
        "both stages, optical h": (patent_angles(optical, seen)[0], ESTIMATE),
    }
    axes = figure.subplots()
    for name, (found, colour) in curves.items():
        axes.semilogy(angle, np.degrees(np.abs(found - true)[:, 0]), color=colour, label=name)
    axes.axhline(0.03, color=INK, ls=(0, (5, 2)), lw=1.0, label="published, 0.03 deg (3 sigma)")
    axes.set(xlabel="angle of the sun alpha, deg", ylabel="error of alpha, deg", xlim=(0, 60), ylim=(1e-4, 20.0))
    plain_decades(axes)


def _small_angle(figure) -> None:
    """Median attitude error over range, 5 deg off nominal: small angles and scaled orthography, either pattern."""
    ranges = np.geomspace(1.5, 30.0, 9)
    axes = figure.subplots()
    patterns = ("three_marker_vision", "one raised", "-"), ("three_marker_vision_flat", "flat", "--")
    for name, pattern, style in patterns:
        model, off = relnav.load_model(name), np.radians(5.0)
        small = [np.degrees(np.median(small_angle_errors(model, r, off, 40, 1)[0])) for r in ranges]
        far = [np.degrees(np.median(scaled_orthography_errors(model, r, off, 40, 1))) for r in ranges]
        axes.loglog(ranges, small, style, color=ESTIMATE, label=f"small angles, {pattern}")
        axes.loglog(ranges, far, style, color=PUBLISHED, label=f"scaled orthography, {pattern}")
    axes.set(xlabel="range, m", ylabel="attitude error, deg", xlim=(1.5, 30.0))
    axes.set_xticks([1.5, 3.0, 5.0, 10.0, 20.0, 30.0], ["1.5", "3", "5", "10", "20", "30"])
    axes.set_xticks([], minor=True)
    plain_decades(axes)


def _two_spots(figure) -> None:
    """Both spots as the sun goes round the boresight at four angles from it."""
    sensor = relnav.load_model("birefringent_sun").sensor
    azimuth = np.radians(np.arange(0.0, 361.0, 5.0))
    axes = figure.subplots()
    for off in (15.0, 30.0, 45.0, 60.0):
        around = np.sin(np.radians(off)) * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        ordinary, extraordinary = 1e3 * np.moveaxis(spots_of_transverse(sensor, around), 1, 0)
        axes.plot(*ordinary.T, color=ESTIMATE, label="ordinary spot")
        axes.plot(*extraordinary.T, color=PUBLISHED, label="extraordinary spot")
        for k in range(0, len(azimuth) - 1, 9):
            axes.plot(*np.stack([ordinary[k], extraordinary[k]]).T, "-", color=QUIET, lw=0.8, label="both of one sun")
        clear = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
        axes.annotate(
            f"{off:g} deg", ordinary[54], ha="center", va="center", color=INK, fontsize="small", bbox=clear, zorder=5
        )
    axes.plot([0.0], [0.0], "+", color=INK, label="opening")
    axes.set(xlabel="detector x, mm (the optic axis leans toward +x)", ylabel="detector y, mm", aspect="equal")


def _nees(figure) -> None:
    """Mean NEES of 20 approaches over time, exact and printed closed form, truth as the filter assumes it."""
    model = relnav.load_model("three_beacon_psd")
    ways = (Way("fix"), Way("fix", projection="parallel"))
    flight = Approach(duration_s=300.0, rate_hz=2.0, assumed_noise=True, assumed_start=True)
    _, outcomes = run_campaign(model, flight, ways, RUNS, 4)
    t = np.arange(1, outcomes[ways[0]].nees.shape[1] + 1) / flight.rate_hz
    axes = figure.subplots()
    for way, name, colour in zip(ways, ("exact closed form", "printed form"), (ESTIMATE, PUBLISHED), strict=True):
        mean = np.mean(outcomes[way].nees, axis=0)
        used = np.isfinite(mean)
        axes.plot(t[used], mean[used], color=colour, label=f"filter on the {name}")
    low, high = (6.0 * bound for bound in chi_square_interval(6 * RUNS, 0.95))
    axes.axhspan(low, high, color=QUIET, alpha=0.3, lw=0, label=f"95 % of an honest filter, {RUNS} runs")
    axes.axhline(6.0, color=INK, ls=(0, (5, 2)), lw=1.0, label="6 states")
    axes.set(xlabel="time, s", ylabel="mean NEES", xlim=(0, 300), ylim=(0, None))


FIGURES = {
    "two_fields": (_two_fields, (6.4, 3.4), "dual_field"),
    "compensation": (_compensation, (6.4, 3.6), "aps_sun"),
    "small_angle": (_small_angle, (6.4, 3.6), "three_marker"),
    "two_spots": (_two_spots, (4.4, 4.7), "birefringent_sun"),
    "nees": (_nees, (6.4, 3.4), "filters"),
}
"""Name of the PNG, what draws it, its size in inches, and the page that shows it."""


def made(name: str):
    """The figure of that name, and all numbers in it: a list of curves of [x, y] rows, six digits each."""
    make, size, _ = FIGURES[name]
    with styled():
        figure = new_figure(*size)
        make(figure)
        named = {}
        for axes in figure.axes:
            handles, labels = axes.get_legend_handles_labels()
            named |= dict(zip(labels, handles, strict=True))
        figure.legend(list(named.values()), list(named), loc="outside lower left", ncols=2)
    curves = [line.get_xydata() for axes in figure.axes for line in axes.get_lines()]
    return figure, [[[float(f"{value:.6g}") for value in row] for row in np.transpose(curve)] for curve in curves]


def numbers_in(path: Path) -> list:
    """What a PNG drawn here says that it shows."""
    from PIL import Image

    with Image.open(path) as picture:
        return json.loads(picture.text[NUMBERS])


def draw(folder: Path) -> None:
    """Write every figure of `FIGURES` as PNG, its numbers inside."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    for name in FIGURES:
        figure, numbers = made(name)
        drawn, about = BytesIO(), PngInfo()
        with styled():
            figure.savefig(drawn, dpi=DOTS_AN_INCH)
        about.add_text(NUMBERS, json.dumps(numbers, separators=(",", ":")), zip=True)
        few = Image.open(drawn).convert("RGB").quantize(64)  # a third of the size
        few.save(folder / f"{name}.png", pnginfo=about, optimize=True)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "theory")
