"""`relnav sun`: what to do with pictures and spots of a sun sensor."""

import click

from relnav.cli import LazyGroup

COMMANDS = {"measure": ("relnav.cli.sun.measure", "Direction of the sun from a picture, or from a log of spots.")}


@click.command(
    cls=LazyGroup, table=COMMANDS, epilog="Example: relnav sun measure spots.csv --model aps_sun --out directions.csv"
)
def command() -> None:
    """Sun sensors: directions with covariance."""
