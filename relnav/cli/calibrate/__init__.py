"""`relnav calibrate`: from a sensor's bench measurements to a calibration file."""

import click

from relnav.cli import LazyGroup

COMMANDS = {
    "sun": ("relnav.cli.calibrate.sun", "An APS sun sensor, from turntable angles and spots."),
}


@click.command(cls=LazyGroup, table=COMMANDS, epilog="Example: relnav calibrate sun turntable.csv --out sun.json")
def command() -> None:
    """Calibrate a sensor from its bench measurements."""
