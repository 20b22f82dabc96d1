"""`relnav filter --follow`: rows in as they come, estimates out line by line, until the input or a signal ends it."""

import gc
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from relnav.cli.live_view import LiveView
from relnav.cli.printing import say
from relnav.cli.settings import given_options
from relnav.cli.track_output import TrackOutput
from relnav.errors import LogError, UsageError

if TYPE_CHECKING:
    from relnav.files.arriving import Arriving
    from relnav.files.live_track import LineByLine
    from relnav.mission import VisionMission
    from relnav.spacecraft import Vehicle

WHOLE_LOG_ONLY = ("smooth", "plot", "corridor_deg", "json_path", "epoch")


@dataclass(frozen=True)
class Live:
    """What is followed, by which model, and where the estimates go."""

    log: Path
    mission: Any
    track: TrackOutput
    method: str | None
    projection: str | None
    quiet: bool


def refuse_options_of_whole_logs() -> None:
    """Refuse options that look at a whole log.

    Raises
    ------
    UsageError
        Naming the first.
    """
    for name, option in given_options():
        if name in WHOLE_LOG_ONLY:
            raise UsageError(
                f"{option} looks at a whole log, --follow at one that grows: keep the log, and run `relnav filter` on "
                "it afterwards"
            )


def run_live(asked: Live, row_format: str | None) -> int:
    """Filter rows as they come; returns the exit code.

    Raises
    ------
    Interrupted, Terminated
        If a signal was the end, after everything before it has been worked through.
    """
    from relnav.files.arriving import Arriving
    from relnav.files.atomic import STDOUT
    from relnav.files.live_track import LineByLine, ending_of

    refuse_options_of_whole_logs()
    gc.freeze()  # what is loaded stays: looking through it again would hold up a row by 20 ms
    out = asked.track.path or STDOUT
    writer = LineByLine(ending_of(out, row_format and f".{row_format}"))
    view = LiveView(f"{asked.log.name}, {asked.mission.name}", on=_is_watched(asked, out))
    with Arriving() as arriving, view:
        try:
            lines, started = _run(asked, arriving, writer, out, view)
        except LogError:
            if not arriving.ended_by:
                raise
            lines, started = [], True  # a signal before there was anything to tell
    if lines and not asked.quiet:
        say(lines, out)
    return _code(arriving.ended_by, started)


def _is_watched(asked: Live, out: Path) -> bool:
    """Whether somebody sits at a terminal to which the track does not go."""
    from relnav.files.atomic import STDOUT
    from relnav.spacecraft import Vehicle

    if asked.quiet or isinstance(asked.mission, Vehicle):
        return False
    return sys.stderr.isatty() and not (out == STDOUT and sys.stdout.isatty())


def _code(ended_by: int, started: bool) -> int:
    import signal

    from relnav.cli import NOT_STARTED, Interrupted, Terminated

    if ended_by:
        raise Terminated if ended_by == signal.SIGTERM else Interrupted
    return 0 if started else NOT_STARTED


def _run(asked: Live, arriving: "Arriving", writer: "LineByLine", out: Path, view: LiveView) -> tuple[list[str], bool]:
    """Lines of the summary, and whether the filter started."""
    from relnav.files.live_log import LiveLog
    from relnav.files.models import flown
    from relnav.mission import VisionMission
    from relnav.spacecraft import Vehicle

    if isinstance(asked.mission, Vehicle):
        return _vehicle(asked, asked.mission, arriving, writer, out, view)
    mission = flown(asked.mission)
    if isinstance(mission, VisionMission):
        return _markers(asked, mission, arriving, writer, out, view)
    from relnav.files.filter_file import filter_file
    from relnav.files.late_log import says_exposures

    log = LiveLog(asked.log, arriving, _telling(view))
    if says_exposures(log):
        raise UsageError(
            f"{asked.log}: image_t_s says that images come late; of beacons --follow takes them as they come: "
            "leave the column out, or filter the log when it is there"
        )
    figures = filter_file(
        log,
        mission,
        out,
        method=asked.method or "fix",
        projection=asked.projection,
        frame=asked.track.frame,
        orientation_deg=asked.track.orbit_deg,
        writer=writer,
        watch=view.watch,
    )
    if not writer.rows:
        return [], True  # whoever reads the track has left before the first row
    return [*figures.lines(asked.log.name), *_left_out(log.refusals.count)], figures.started


def _markers(
    asked: Live, mission: "VisionMission", arriving: "Arriving", writer: "LineByLine", out: Path, view: LiveView
) -> tuple[list[str], bool]:
    from relnav.cli.marker_filter import Summary, lines
    from relnav.files.live_log import LiveLog
    from relnav.files.marker_logs import marker_header, marker_solutions, write_track
    from relnav.navigation.lasting_words import marker_words

    log = LiveLog(asked.log, arriving, _telling(view), marker_header(mission))
    summary = Summary(mission)
    parts = view.passing(summary.passing(marker_solutions(log, mission)))
    stated = {"log": asked.log.name} | marker_words(mission)
    write_track(parts, mission.name, out, stated, writer, asked.track.turning(mission))
    if not writer.rows:
        return [], True
    figures = summary.figures()
    return [*lines(figures, asked.log.name), *_left_out(log.refusals.count)], figures["epochs_with_state"] > 0


def _vehicle(
    asked: Live, vehicle: "Vehicle", arriving: "Arriving", writer: "LineByLine", out: Path, view: LiveView
) -> tuple[list[str], bool]:
    from relnav.cli.vehicle import Summary, asked_frame, refuse_others
    from relnav.files.live_log import Refusals, refuse_parquet
    from relnav.files.live_vehicle import live_rows
    from relnav.files.text_table import TextTable
    from relnav.files.vehicle_log import filter_rows
    from relnav.files.vehicle_track import write_port_track

    refuse_others()
    refuse_parquet(asked.log)
    table, refusals = TextTable(asked.log, arriving), Refusals(asked.log, _telling(view))
    summary = Summary(vehicle)
    rows = summary.counted(live_rows(table, vehicle, refusals))
    parts = filter_rows(rows, vehicle, refuse=refusals.refuse, late=summary.late)
    write_port_track(summary.passing(parts), vehicle, out, {"log": asked.log.name}, writer, asked_frame())
    if not writer.rows:
        return [], True
    return [*summary.lines(asked.log.name), *_left_out(refusals.count)], True


def _telling(view: LiveView) -> Callable[[str], None]:
    """What takes a sentence on a row that is left out."""
    from relnav.cli import fail

    def tell(sentence: str) -> None:
        view.left_out += 1
        fail(sentence, 0)

    return tell


def _left_out(count: int) -> list[str]:
    return [f"{count} row{'s' if count > 1 else ''} left out, reported above"] if count else []
