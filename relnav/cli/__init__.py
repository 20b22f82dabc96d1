"""The command line: `relnav COMMAND`. Commands load what they need when they run, so `--help` is instant.

Exit codes: 0 done, 1 accuracy not met, 2 wrong use, 3 bad input, 4 internal error, 130 interrupted.
"""

import os
import sys
from importlib import import_module
from typing import Any

import click

COMMANDS = {
    "budget": ("relnav.cli.budget", "Say what accuracy a design will reach, and what limits it."),
    "accuracy": ("relnav.cli.accuracy", "Measure what a sensor system reaches, beside what its paper claims."),
    "calibrate": ("relnav.cli.calibrate", "Calibrate a sensor from its bench measurements."),
    "filter": ("relnav.cli.filter", "Filter a log of spots into a track with covariance."),
    "simulate": ("relnav.cli.simulate", "Simulate an approach: a log of spots and its truth."),
    "models": ("relnav.cli.models", "List the shipped models, or show one with its sources."),
    "stars": ("relnav.cli.stars", "Star frames: inertial attitude from the spots of one image."),
}
"""Name -> module that holds it as `command`, and its line in the list."""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called; `table` is like COMMANDS."""

    def __init__(self, *args: Any, table: dict[str, tuple[str, str]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.table = table

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's signature)
        """Names of the commands."""
        return sorted(self.table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002  (likewise)
        """Import and return one command."""
        if cmd_name not in self.table:
            return None
        command: click.Command = import_module(self.table[cmd_name][0]).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.table[name][1]) for name in self.list_commands(ctx)])


@click.command(
    cls=LazyGroup,
    table=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: relnav filter approach.csv --model three_beacon_psd --out track.csv",
)
@click.version_option(package_name="relnav")
def root() -> None:
    """Optical relative navigation: from detector spots to a relative state and a covariance one can trust."""


def fail(message: str, code: int) -> int:
    """Say what went wrong on standard error; returns the exit code."""
    click.echo(f"relnav: {message}", err=True)
    return code


def _give_up_output() -> None:
    """Leave what cannot be printed unprinted: Python would try again at exit, and complain."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def run(arguments: list[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    from relnav.errors import InputError, UsageError

    try:
        result = root.main(args=arguments, prog_name="relnav", standalone_mode=False)
        return result if isinstance(result, int) else 0
    except click.ClickException as error:
        error.show()
        return 2
    except (KeyboardInterrupt, click.Abort):
        return fail("interrupted; nothing was written", 130)
    except UsageError as error:
        return fail(str(error), 2)
    except InputError as error:
        return fail(str(error), 3)
    except SystemExit:
        return 0  # click's way of ending when whoever reads the output has left
    except OSError as error:
        named = f"{error.filename}: " if error.filename else ""
        _give_up_output()
        return fail(f"{named}{error.strerror or error}; nothing was written", 3)
    except Exception as error:
        if os.environ.get("RELNAV_DEBUG"):
            raise
        return fail(
            f"internal error, please report it: {type(error).__name__}: {error} (RELNAV_DEBUG=1 shows where)", 4
        )


def main() -> None:
    """Entry point of the `relnav` command."""
    sys.exit(run())
