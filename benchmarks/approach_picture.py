"""Draw the example approach: errors of the filtered track and its 1-sigma, beside the published figures.

    python benchmarks/approach_picture.py --out docs/approach.png

Truth is that of the flight simulator that made the log, so this is an error, not a residual.
"""

import argparse
from pathlib import Path

import numpy as np

import relnav
from relnav.files.picture_style import (
    ESTIMATE,
    QUIET,
    heading,
    named_line,
    new_figure,
    one_legend,
    plain_decades,
    save,
    styled,
)

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "basilisk_approach"
QUANTITIES = (("range", "m", 1.0), ("azimuth", "deg", 180.0 / np.pi), ("elevation", "deg", 180.0 / np.pi))

ATTITUDE = "0.15 deg are what the attitude may be wrong by;\nhere it is exact, so that errors lie far below"


def true_docking(truth: np.ndarray) -> np.ndarray:
    """Range, azimuth, elevation of true positions; the example's docking frame is parallel to lvlh_ccsds."""
    x, y, z = truth[:, 1], truth[:, 2], truth[:, 3]
    return np.stack([np.sqrt(x * x + y * y + z * z), np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))], axis=1)


def draw(out: Path) -> None:
    """Filter the example by both methods and write the picture."""
    truth = true_docking(np.loadtxt(EXAMPLE / "vbar_truth.csv", delimiter=",", skiprows=1))
    claims = {claim.quantity: claim for claim in relnav.load_published("three_beacon_psd").claims}
    with styled():
        figure = new_figure(11.0, 7.6)
        axes = figure.subplots(3, 2, sharex=True, sharey="row")
        for column, method in enumerate(("fix", "spots")):
            solution = relnav.filter_log(EXAMPLE / "vbar_log.csv", "three_beacon_psd", method=method)
            error, sigma = np.abs(solution.docking - truth), solution.docking_sigma
            for row, (quantity, unit, scale) in enumerate(QUANTITIES):
                axis, claim = axes[row, column], claims[quantity]
                t, away, said = solution.t_s, error[:, row] * scale, sigma[:, row] * scale
                axis.semilogy(t, away, ".", ms=1.2, color=QUIET, label="|error| after each image")
                axis.semilogy(t, said, color=ESTIMATE, lw=1.6, label="reported 1-sigma")
                named_line(axis, claim.value, f"published {claim.value:g} {unit}")
                if row and method == "spots":
                    place = {"xycoords": "axes fraction", "ha": "right", "va": "top"}
                    axis.annotate(ATTITUDE, (0.985, 0.70), color=ESTIMATE, **place)
                axis.set_ylim(1e-5, 2.0)
                axis.set_title(f"{quantity.capitalize()}, method {method}")
                axis.set_ylabel(unit if column == 0 else "")
                axis.margins(x=0.01)
                plain_decades(axis)
            axes[2, column].set_xlabel("time, s")
        heading(figure, "An approach from 10 m to 4 m flown in another simulator: error, and what the filter says")
        one_legend(figure)
        save([figure], out)


def main() -> None:
    """Draw it where it was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("approach.png"))
    out = parser.parse_args().out
    draw(out)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
