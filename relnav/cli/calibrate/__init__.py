"""`relnav calibrate SENSOR`: from bench measurements of something known to a calibration that a model file can name."""

import click

from relnav.cli import LazyGroup

COMMANDS = {
    "fold": ("relnav.cli.calibrate.fold", "The second field of a star sensor, from frames of the sky."),
    "psd": ("relnav.cli.calibrate.psd", "Fit a position-sensitive detector's distortion from a grid of known spots."),
    "sun": (
        "relnav.cli.calibrate.sun",
        "A sun sensor, from turntable angles and spots, or (birefringent) from its spots.",
    ),
}


@click.command(cls=LazyGroup, table=COMMANDS, epilog="Example: relnav calibrate psd grid.csv --out calibration.toml")
def command() -> None:
    """Calibrate a sensor from bench measurements of something known."""
