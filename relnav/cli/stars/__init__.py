"""`relnav stars`: what to do with frames of star spots."""

import click

from relnav.cli import LazyGroup

RESIDUAL = (
    "Instead of the model's spot_noise_px: each spot's own noise, columns sigma_x_px, sigma_y_px, correlation, and "
    "this 1-sigma, px, that the lens model leaves."
)

COMMANDS = {
    "attitude": ("relnav.cli.stars.attitude", "A log of frames as attitudes for the navigation filter."),
    "solve": ("relnav.cli.stars.solve", "Attitude and matched stars of one frame."),
}


@click.command(
    cls=LazyGroup, table=COMMANDS, epilog="Example: relnav stars solve frame.csv --model ground_camera --json out.json"
)
def command() -> None:
    """Star frames: inertial attitude from the spots of one image, lost in space."""
