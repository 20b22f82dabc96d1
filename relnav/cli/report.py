"""`relnav report`: one page that shows a run, an accuracy report or a campaign, and holds all it needs."""

from pathlib import Path
from typing import Any

import click

from relnav.cli.completion import FLOWN, ModelName
from relnav.cli.help_groups import GroupedCommand, OptionsOf
from relnav.cli.printing import InputPath, OutputPath, say
from relnav.cli.settings import given_options

_page, _log, _limits = map(OptionsOf, ("Page", "Run", "Your limits, drawn and compared"))


@click.command(cls=GroupedCommand, epilog="Example: relnav report track.csv --out run.html")
@click.argument("source", type=InputPath(folders=True))
@_page("--out", type=OutputPath(), required=True, help="Page to write, .html; it needs no network.")
@_log(
    "--model",
    type=ModelName(*FLOWN),
    help="Model of SOURCE if SOURCE does not name it, or with which SOURCE is filtered as a log.",
)
@_log("--method", type=click.Choice(["fix", "spots"]), help="To filter a log: as for `relnav filter`.")
@_log("--smooth", is_flag=True, help="To filter a log: add a backward pass.")
@_limits(
    "--corridor-deg",
    type=click.FloatRange(min=0.0, max=80.0, min_open=True),
    default=10.0,
    show_default=True,
    help="Half angle of your approach corridor.",
)
@_limits(
    "--capture-m",
    type=click.FloatRange(min=0.0),
    default=0.0,
    help="Largest lateral misalignment that your port captures: farthest from its axis.",
)
@_limits(
    "--capture-distance-m",
    type=click.FloatRange(min=0.0),
    default=0.0,
    help="Farthest along the port's axis at which it captures.",
)
@_limits(
    "--capture-deg",
    type=click.FloatRange(min=0.0, max=180.0),
    default=0.0,
    help="Largest angular misalignment that it captures, where the run has a relative attitude.",
)
@_page("--quiet", is_flag=True, help="Print nothing.")
def command(
    source: Path,
    out: Path,
    model: str | None,
    method: str | None,
    smooth: bool,
    corridor_deg: float,
    capture_m: float,
    capture_distance_m: float,
    capture_deg: float,
    quiet: bool,
) -> None:
    """Write a page of SOURCE: a track, an accuracy report (.json), a campaign's folder, or a log with its --model.

    A track is .csv or .parquet. A log is filtered first: its page shows innovations and gates, which a track does not
    hold.
    """
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.report_page import check_page

    check_page(out)
    check_folder(out)
    check_distinct(source, out)
    if source.is_dir() or source.suffix.lower() == ".json":
        _refuse_options_of_runs(source)
    if source.is_dir():
        from relnav.files.campaign_page import read_campaign, write_campaign_page

        flown = read_campaign(source)
        with Outputs() as outputs:
            write_campaign_page(flown, outputs.path(out, ".html"))
    elif source.suffix.lower() == ".json":
        from relnav.files.accuracy_page import read_report, write_accuracy_page

        report = read_report(source)
        with Outputs() as outputs:
            write_accuracy_page(report, outputs.path(out, ".html"))
    else:
        view, mission, notes = _run(source, model, method, smooth)
        from relnav.files.approach_view import CaptureLimits
        from relnav.files.run_page import write_run_page

        capture = CaptureLimits(capture_m, capture_distance_m, capture_deg)
        with Outputs() as outputs:
            write_run_page(view, mission, outputs.path(out, ".html"), corridor_deg, capture, notes)
    if not quiet:
        say([f"page: {out}"], out)


def _refuse_options_of_runs(source: Path) -> None:
    """Refuse options that only a track or a log has a use for."""
    from relnav.errors import UsageError

    for name, option in given_options():
        if name not in ("source", "out", "quiet"):
            raise UsageError(f"{option} is for a track or a log; {source} says all that its page shows")


def _run(source: Path, model: str | None, method: str | None, smooth: bool) -> tuple[Any, Any, tuple[str, ...]]:
    """What there is to see of a track, or of a log that is filtered for it; its mission; notes for the reader."""
    from relnav.errors import UsageError
    from relnav.files.logs import opened
    from relnav.files.run_page import GROUPS
    from relnav.files.track_file import is_track

    head = opened(source)
    if is_track(_names(head, source)):
        return _of_track(source, head, model)
    if model is None:
        raise UsageError(f"{source}: no track, and to be filtered as a log it needs --model (see `relnav models`)")
    mission = _flown(model)
    watcher = _watcher(mission, GROUPS)
    _filter(head, mission, method, smooth, watcher)
    return watcher.view(source.name), mission, ()


def _of_track(source: Path, head: Any, model: str | None) -> tuple[Any, Any, tuple[str, ...]]:
    from relnav.errors import UsageError
    from relnav.files.model_folders import list_models
    from relnav.files.run_page import GROUPS
    from relnav.files.track_file import TrackFile
    from relnav.files.vehicle_view import vehicle_watcher
    from relnav.spacecraft import Vehicle

    track = TrackFile(head)
    stated = track.metadata.get("model", "")
    known = model or (stated if stated in list_models() else "")
    mission = _flown(known) if known else None
    if mission is not None and isinstance(mission, Vehicle) != track.of_vehicle:
        kind = "a vehicle's" if track.of_vehicle else "no vehicle's"
        raise UsageError(f"{source}: {kind} track, and --model {known} is {'no' if track.of_vehicle else 'a'} vehicle")
    watcher = vehicle_watcher(None, GROUPS) if track.of_vehicle and mission is None else _watcher(mission, GROUPS)
    for part in track.parts():
        watcher.take_columns(part)
    how = track.metadata.get("method", "")
    title = (stated or model or "track") + (f", method {how}" if how else "")
    note = "A track holds no innovations; `relnav report LOG --model MODEL` shows them with their gates."
    return watcher.view(source.name, title, track.metadata), mission, () if track.of_vehicle else (note,)


def _flown(model: str) -> Any:
    """What is flown: a mission, or a vehicle."""
    from relnav.files.models import flown, load_model
    from relnav.spacecraft import Vehicle

    loaded = load_model(model)
    return loaded if isinstance(loaded, Vehicle) else flown(loaded)


def _watcher(mission: Any, most: int) -> Any:
    from relnav.files.run_view import watcher_of
    from relnav.files.vehicle_view import vehicle_watcher
    from relnav.spacecraft import Vehicle

    return vehicle_watcher(mission, most) if isinstance(mission, Vehicle) else watcher_of(mission, most)


def _names(head: Any, source: Path) -> list[str]:
    if isinstance(head, Path):
        from relnav.files.parquet import open_parquet

        return open_parquet(source)[1]
    names: list[str] = head.names
    return names


def _filter(head: Any, mission: Any, method: str | None, smooth: bool, watcher: Any) -> None:
    from relnav.errors import UsageError
    from relnav.mission import VisionMission
    from relnav.spacecraft import Vehicle

    if isinstance(mission, Vehicle):
        from relnav.files.vehicle_log import filter_rows, read_vehicle_log, smoothed_rows

        if method is not None:
            raise UsageError(f"--method is not for a vehicle: {mission.name} has one filter")
        for _ in watcher.passing((smoothed_rows if smooth else filter_rows)(read_vehicle_log(head, mission), mission)):
            pass
        return
    if isinstance(mission, VisionMission):
        from relnav.files.marker_logs import marker_solutions

        if method is not None:
            raise UsageError(f"--method is for three-beacon models; {mission.name} has one filter, on its spots")
        for part in marker_solutions(head, mission, smooth=smooth):
            watcher.take(part)
        return
    from relnav.files.filter_file import filter_file

    filter_file(head, mission, method=method or "fix", smooth=smooth, watch=watcher.take)
