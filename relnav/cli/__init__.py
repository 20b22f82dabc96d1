"""The command line: `relnav COMMAND`. Commands load what they need when they run, so `--help` is instant.

Exit codes:

    0    done; also if whoever reads standard output leaves before the end
    1    `accuracy` alone: a figure did not come out as its model expects, or there was nothing to compare
    2    wrong use: an option, a name, an output that cannot be
    3    bad input, or a file or standard output that cannot be written
    4    internal error
    5    `filter` alone: the filter never started, the track holds no state
    130  interrupted (SIGINT), 143 terminated (SIGTERM)

Files of a command appear together when its work is done, or not at all: before anything is printed. The track of
`filter --follow` alone is written line by line, where it shall be.
"""

import os
import signal
import sys
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import click

COMMANDS = {
    "budget": ("relnav.cli.budget", "Error budget of a design: the accuracy that it reaches, and what limits it."),
    "accuracy": ("relnav.cli.accuracy", "Measure the accuracy of a sensor system, and compare it with its paper."),
    "campaign": ("relnav.cli.campaign", "Fly many approaches of a scenario: distributions and consistency."),
    "calibrate": ("relnav.cli.calibrate", "Calibrate a sensor from its bench measurements."),
    "filter": ("relnav.cli.filter", "Filter a log of spots into a track with covariance."),
    "report": ("relnav.cli.report", "Write a report page of a run, a campaign or an accuracy report."),
    "simulate": ("relnav.cli.simulate", "Simulate an approach: a log of spots and its truth."),
    "models": ("relnav.cli.models", "List the shipped models, or show one with its sources."),
    "stars": ("relnav.cli.stars", "Star frames: inertial attitude from the spots of one image."),
    "sun": ("relnav.cli.sun", "Sun sensors: directions from pictures and logs of spots."),
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

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that is named; of a misspelt one, say what was meant."""
        if args[0] not in self.table and not args[0].startswith("-") and not ctx.resilient_parsing:
            near = get_close_matches(args[0], self.table, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(self.list_commands(ctx))}"
            ctx.fail(f"No such command '{args[0]}'; {hint}")
        return super().resolve_command(ctx, args)

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


AGAIN_S = 0.05
"""After which a signal is sent again that was dropped."""
NOT_MET, WRONG_USE, BAD_INPUT, INTERNAL, NOT_STARTED, INTERRUPTED, TERMINATED = 1, 2, 3, 4, 5, 130, 143


class Interrupted(KeyboardInterrupt):
    """The program was asked to end by SIGINT.

    A class of its own: Python before 3.13 remembers a bare KeyboardInterrupt that passes through `exec` of a text
    and at the end kills the process by SIGINT, although it was caught and an exit code given.
    """


class Terminated(KeyboardInterrupt):
    """The program was asked to end by SIGTERM."""


def fail(message: str, code: int) -> int:
    """Say what went wrong on standard error; returns the exit code."""
    from relnav.cli.printing import leave_unprinted, visible

    if sys.stderr is not None:
        try:
            sys.stderr.write(visible(f"relnav: {message}\n", sys.stderr))
            sys.stderr.flush()
        except (OSError, ValueError):
            leave_unprinted(sys.stderr)
    return code


def run(arguments: list[str] | None = None) -> int:
    """Run one command line; returns the exit code."""
    written: list[str] = []
    try:
        return _command(arguments, written)
    except SystemExit:
        return 0  # click's way of ending when whoever reads the help has left
    except click.ClickException as error:
        error.show()
        return WRONG_USE
    except BaseException as error:
        ended = error if isinstance(error, KeyboardInterrupt) or not _ASKED else _ASKED[-1]()
        if os.environ.get("RELNAV_DEBUG") and _code(ended) == INTERNAL:
            raise
        done = f"written: {', '.join(written)}" if written else "nothing was written"
        return fail(_sentence(ended, done), _code(ended))


def _command(arguments: list[str] | None, written: list[str]) -> int:
    """Run one command line; the names of the files it has put in place are added to `written`."""
    from relnav.files.atomic import IN_PLACE

    token = IN_PLACE.set(written)
    try:
        result = root.main(args=arguments, prog_name="relnav", standalone_mode=False)
    finally:
        IN_PLACE.reset(token)
    return result if isinstance(result, int) else 0


def _code(error: BaseException) -> int:
    """Exit code of what ended a command."""
    from relnav.cli.printing import PrintError
    from relnav.errors import InputError, UsageError

    if isinstance(error, KeyboardInterrupt | click.Abort):
        return TERMINATED if isinstance(error.__cause__ or error, Terminated) else INTERRUPTED
    if isinstance(error, UsageError):
        return WRONG_USE
    return BAD_INPUT if isinstance(error, InputError | OSError | PrintError) else INTERNAL


def _sentence(error: BaseException, done: str) -> str:
    """What to say of it; `done` is what became of the files."""
    from relnav.cli.printing import PrintError
    from relnav.errors import InputError, UsageError

    if isinstance(error, KeyboardInterrupt | click.Abort):
        return f"{'terminated' if _code(error) == TERMINATED else 'interrupted'}; {done}"
    if isinstance(error, UsageError | InputError):
        return str(error)
    if isinstance(error, PrintError):
        return f"{error}; {done}"
    if isinstance(error, OSError):
        named = f"{error.filename}: " if error.filename else ""
        return f"{named}{error.strerror or error}; {done}"
    if isinstance(error, MemoryError):
        return f"internal error: not enough memory; {done}"
    said = f"{type(error).__name__}: {error}"
    return f"internal error, please report it: {said} (RELNAV_DEBUG=1 shows where)"


def main() -> None:
    """Run the command line of this process; `relnav/__main__.py` is what begins it."""
    _open_streams()
    sys.unraisablehook = _dropped
    for number, handler in ((signal.SIGTERM, _terminate), (signal.SIGINT, _interrupt)):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, handler)
    sys.exit(run())


_ASKED: list[type[KeyboardInterrupt]] = []
"""How the program was asked to end. An error that follows may come of it: LLVM's call back into Python drops what is
raised there, and numba then misses what it was to be given."""


def _interrupt(number: int, frame: object) -> None:  # noqa: ARG001  (the signature of a signal's handler)
    _ASKED.append(Interrupted)
    raise Interrupted


def _terminate(number: int, frame: object) -> None:  # noqa: ARG001  (the signature of a signal's handler)
    _ASKED.append(Terminated)
    raise Terminated


def _dropped(what: Any) -> None:
    """An exception that Python could not raise where it came: of a signal, send it again; of others, say them."""
    if not isinstance(what.exc_value, Interrupted | Terminated):
        sys.__unraisablehook__(what)
        return
    import threading

    number = signal.SIGTERM if isinstance(what.exc_value, Terminated) else signal.SIGINT
    again = threading.Timer(AGAIN_S, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()


def _open_streams() -> None:
    """A stream that was closed gets the null device: else the next file opened would take its number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115  (for as long as the program runs)
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115  (likewise)
