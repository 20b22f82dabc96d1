"""`relnav filter`: a log of spots in, a track with covariance out, and a summary beside the published figures."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.completion import FLOWN, ModelName
from relnav.cli.epoch_bar import epoch_bar
from relnav.cli.help_groups import GroupedCommand, OptionsOf
from relnav.cli.picture import Picture
from relnav.cli.printing import InputPath, OutputPath, say
from relnav.cli.track_output import TrackOutput
from relnav.errors import UsageError

if TYPE_CHECKING:
    from relnav.accuracy.run_summary import RunSummary

PLAIN_BELOW_BYTES = 1_000_000
"""About 12,000 epochs: 4 to 8 s in plain Python, against most of a minute of compilation."""


_input, _filter_options, _output, _picture = map(OptionsOf, ("Input", "Filter", "Output", "Picture"))


@click.command(
    cls=GroupedCommand, epilog="Example: relnav filter approach.csv --model three_beacon_psd --out track.csv"
)
@click.argument("log", type=InputPath(bags=True))
@_input(
    "--model",
    type=ModelName(*FLOWN),
    required=True,
    help="A shipped model (see `relnav models`), a folder or a model.toml.",
)
@_input(
    "-f",
    "--follow",
    is_flag=True,
    help="LOG (CSV) is still being written, or - is a pipe: each estimate is written as soon as its row has arrived, "
    "until the input ends or Ctrl-C. An invalid row is reported and skipped.",
)
@_filter_options(
    "--method",
    type=click.Choice(["fix", "spots"]),
    show_default="fix",
    help="Measurement model: range, azimuth and elevation of the closed form, which need three spots and not the "
    "camera's attitude (images that contradict a stated one are rejected); or the spots: ten times more accurate "
    "angles, but with the full error of the attitude.",
)
@_filter_options(
    "--projection",
    type=click.Choice(["perspective", "parallel"]),
    help="Closed form: exact for real optics, or as printed in the paper. Default: the model's.",
)
@_filter_options(
    "--engine",
    type=click.Choice(["compiled", "filterpy"]),
    default="compiled",
    show_default=True,
    help="relnav's filter, or the same one written a second time on filterpy: a hundred times slower, for comparison.",
)
@_filter_options(
    "--smooth", is_flag=True, help="Add a backward pass: every state is then estimated from all measurements."
)
@_output(
    "--out",
    type=OutputPath(),
    help="Track to write, .csv, .jsonl or .parquet (- is standard output), .oem, .aem, .mat, .nc, .h5, .mcap, "
    ".rosbag2, .bsp or .bc.",
)
@_output(
    "--format",
    "row_format",
    type=click.Choice(["csv", "jsonl"]),
    help="Of a track without an ending (-, a pipe): CSV, or JSON lines, an object a row. Default: csv.",
)
@_output(
    "--frame",
    type=click.Choice(["lvlh_ccsds", "rsw", "dock", "eci_relative", "eci"]),
    default="lvlh_ccsds",
    show_default=True,
    help="Frame of the track's states, attitudes and covariances; rsw is RTN, RIC, Hill. A vehicle's track, the "
    "relative state of the ports in target axes, then also has centre of mass and target's attitude in this frame.",
)
@_output(
    "--orbit-deg",
    type=float,
    nargs=3,
    help="For eci, .aem, .bsp and .bc: inclination, right ascension of the ascending node, argument of perigee of the "
    "target's orbit.",
)
@_output("--epoch", help="For .oem, .aem, .bsp and .bc: UTC of the log's t = 0, 2026-07-02T12:00:00.")
@_output("--json", "json_path", type=OutputPath(), help="Write the summary as one JSON object.")
@_output("--quiet", is_flag=True, help="Print nothing.")
@_picture("--plot", type=OutputPath(), help="Draw the run, .png, .pdf or .svg: approach, state, measurements.")
@_picture(
    "--corridor-deg",
    type=click.FloatRange(min=0.0, max=80.0, min_open=True),
    default=10.0,
    show_default=True,
    help="Half angle of your approach corridor, for the picture.",
)
def command(
    log: Path,
    model: str,
    follow: bool,
    method: str | None,
    projection: str | None,
    engine: str,
    smooth: bool,
    out: Path | None,
    row_format: str | None,
    frame: str,
    orbit_deg: tuple[float, float, float] | None,
    epoch: str | None,
    json_path: Path | None,
    quiet: bool,
    plot: Path | None,
    corridor_deg: float,
) -> int:
    """Filter the spots of LOG (CSV or Parquet, one row per epoch) into range, azimuth, elevation and a relative state.

    LOG may be a pipe, - is standard input (CSV); it may be a ROS bag whose messages name spots.

    Columns of LOG: t_s; spot_a_x_um, spot_a_y_um, spot_b_..., spot_c_..., and spot_d_..., of further beacons
    (extra_beacons_mm in the model), in any length unit, empty = not seen;
    optionally sigma_spot_a_x_um, ... (1-sigma of each coordinate's noise, of all spots or of none, empty = as before),
    accel_{x,y,z}_m_s2, delta_v_{x,y,z}_m_s (lvlh_ccsds), q_cam_from_lvlh_{x,y,z,w}, image_t_s (middle of the
    exposure, if images may be late and the model has a longest_delay_s). A raw log of a detector
    (CSV, one row per slot) has t_s, beacon (a, b, c or dark), and adc_{x1,x2,y1,y2} or current_{x1,x2,y1,y2}_na instead
    of spots; with --method spots every spot is processed at its own time, otherwise images are, joined at C's
    time. For a marker model: spot_a_x_px, spot_a_y_px, ..., optionally sigma_spot_a_x_px, ... (empty = the model's
    spot_noise_px), q_chaser_from_lvlh_{x,y,z,w}, image_t_s; the track then holds attitude and rate, and the relative
    state of the ports. For a vehicle: t_s, sensor, v0, v1, ..., one row per observation in any order; the track holds
    the relative state of the ports every second.

    With --follow the track is .csv or .jsonl, on standard output unless --out names another place.

    Exit code 5: the filter never started, and the track holds no state.
    """
    if follow and engine != "compiled":
        raise UsageError("--engine filterpy is for comparison, on a log that is complete: leave --follow or it out")
    if not follow:
        _choose_engine(log, model)
    from relnav.cli import NOT_STARTED
    from relnav.cli.live import Live, run_live
    from relnav.cli.marker_filter import filter_markers
    from relnav.cli.vehicle import filter_vehicle, refuse_others
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.models import load_mission, load_model
    from relnav.files.tables import write_json
    from relnav.mission import Model, VisionMission
    from relnav.spacecraft import Vehicle

    track = TrackOutput(out, frame, orbit_deg, epoch, row_format)
    track.check()
    if json_path is not None:
        check_folder(json_path)
    picture = Picture(plot, corridor_deg)
    check_distinct(log, out, track.clock, plot, json_path)
    mission = load_model(model)
    if isinstance(mission, Model | VisionMission):
        track.check_settings(mission, follow=follow)
    if follow:
        return run_live(Live(log, mission, track, method, projection, quiet), row_format)
    if isinstance(mission, Vehicle):
        refuse_others()
        return filter_vehicle(log, mission, out, json_path, picture, smooth=smooth, quiet=quiet)
    if isinstance(mission, VisionMission):
        return filter_markers(
            log,
            mission,
            track,
            json_path,
            picture,
            quiet=quiet,
            smooth=smooth,
            engine=engine,
            refused=_given(method, projection),
        )
    picture.of(mission)
    mission = load_mission(model)
    with Outputs() as outputs:
        figures = _filter(
            log, mission, track, track.table(outputs), method or "fix", projection, engine, smooth, picture, quiet
        )
        track.finish(outputs, mission)
        picture.draw(outputs, log)
        if json_path is not None:
            write_json(figures.to_dict(), outputs.path(json_path))
    if not quiet:
        say([*figures.lines(log.name), *picture.said(track.written)], out, plot, json_path)
    return 0 if figures.started else NOT_STARTED


def _given(method: str | None, projection: str | None) -> str:
    """An option that a marker model has no use for, if one was given."""
    given = (method is not None, "--method"), (projection is not None, "--projection")
    return next((name for here, name in given if here), "")


def _choose_engine(log: Path, model: str) -> None:
    """Run a short log as plain Python where nothing is compiled yet: 2 s instead of a minute, and the same track."""
    if "RELNAV_JIT" in os.environ or "relnav.codegen.kernel" in sys.modules or not log.is_file():
        return
    if log.stat().st_size >= PLAIN_BELOW_BYTES:
        return
    from relnav.codegen.store import at_hand
    from relnav.files.model_folders import sensor_type

    loop = "pose_log" if sensor_type(model) == "three_marker" else "log"
    if not at_hand(f"relnav.navigation.{loop}._run"):
        os.environ["RELNAV_JIT"] = "0"


def _filter(
    log: Path,
    mission: Any,
    track: TrackOutput,
    table: Path | None,
    method: str,
    projection: str | None,
    engine: str,
    smooth: bool,
    picture: Picture,
    quiet: bool,
) -> "RunSummary":
    from relnav.files.filter_file import filter_file

    def watch(part: Any) -> None:
        picture.watch(part)
        track.watch(part)

    def run(progress: Callable[[int], None] | None) -> "RunSummary":
        return filter_file(
            log,
            mission,
            table,
            method=method,
            projection=projection,
            engine=engine,
            smooth=smooth,
            progress=progress,
            watch=watch,
            frame=track.frame,
            orientation_deg=track.orbit_deg,
        )

    with epoch_bar(log, quiet=quiet, note=" of three passes" if smooth else "") as progress:
        return run(progress)
