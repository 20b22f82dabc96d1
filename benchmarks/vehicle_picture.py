"""Draw an approach of the shipped vehicle: errors at the docking port and their reported 1-sigma, by distance.

    python benchmarks/vehicle_picture.py --out docs/vehicle.png

Truth is that of the simulator, which shares nothing with the filter. The same flight is filtered with beacons, star
sensor and gyro alone, as by who has no more.
"""

import argparse
from pathlib import Path

import numpy as np

import relnav
from relnav.accuracy.rendezvous import fly
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
from relnav.simulation.vehicle_sensors import simulate_rendezvous

FLOWN = (("camera", "sun_aps", "sun_birefringent"), "beacons and a star sensor"), ((), "all five sensors")
QUANTITIES = (("Along the port's axis", slice(0, 1), 1.0, "m"), ("Attitude", slice(6, 9), np.degrees(1.0), "deg"))
PUBLISHED = 0.02, "published for beacons alone, 0.02 m"


def draw(out: Path) -> None:
    """Fly once, filter twice, and write the picture."""
    run = simulate_rendezvous(relnav.load_model("rendezvous_demo"), seed=1)
    ranges = np.linspace(29.0, 1.0, 120)
    with styled():
        figure = new_figure(11.0, 5.6)
        axes = figure.subplots(2, 2, sharex=True, sharey="row")
        for column, (without, title) in enumerate(FLOWN):
            points = fly(run, ranges, without)
            for row, (quantity, part, scale, unit) in enumerate(QUANTITIES):
                axis = axes[row, column]
                error = np.array([np.abs(point.port_error[part]).max() for point in points]) * scale
                sigma = np.array([np.sqrt(np.diagonal(point.port_covariance)[part]).max() for point in points]) * scale
                axis.semilogy(ranges, error, ".", ms=3.0, color=QUIET, label="|error|, the largest axis")
                axis.semilogy(ranges, sigma, color=ESTIMATE, lw=1.6, label="reported 1-sigma")
                if row == 0:
                    named_line(axis, *PUBLISHED)
                axis.set_title(f"{quantity}: {title}")
                axis.set_ylabel(unit if column == 0 else "")
                axis.margins(x=0.01)
                plain_decades(axis)
        axes[0, 0].invert_xaxis()
        for axis in axes[-1]:
            axis.set_xlabel("port to port, m")
        heading(figure, "An approach of one vehicle: error at the docking port, and what the filter says")
        one_legend(figure)
        save([figure], out)


def main() -> None:
    """Draw it where it was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("vehicle.png"))
    out = parser.parse_args().out
    draw(out)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
