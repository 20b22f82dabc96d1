"""From a log file to a track file in bounded memory: the log is streamed, however long it is.

Smoothing passes three times over the log: it is filtered into a temporary file, smoothed there from the last chunk to
the first, and read from it in order. The chunks run on the same kernels as a log in memory: the bits are the same.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from relnav.accuracy.run_summary import RunSummary
from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.error_state import MOTION
from relnav.dynamics.in_frame import Turning
from relnav.errors import UsageError
from relnav.files.attitude_reading import ROWS_TRIED, reading_that_starts, stepped, turns_of
from relnav.files.frame_logs import log_in_memory
from relnav.files.gathered import Gathered
from relnav.files.late_log import filter_late_log, says_exposures
from relnav.files.log_columns import ACCELERATION, DELTA_V, log_metadata
from relnav.files.logs import Log, LogFile, check_beacons, opened
from relnav.files.models import load_mission, load_published
from relnav.files.raw_filter import filter_raw_log
from relnav.files.raw_logs import is_raw_log
from relnav.files.rounded_spots import rounded
from relnav.files.spool import Spool
from relnav.files.tables import COLUMNS, INTEGERS, Table, Writer, head, rows_of, write_table
from relnav.files.text_table import TextTable
from relnav.files.tracks import write
from relnav.files.wording import listed
from relnav.mission import Model
from relnav.navigation.arguments import controls
from relnav.navigation.lasting_words import lasting_words
from relnav.navigation.log import Epochs, LogFilter
from relnav.navigation.record import Solution

FAR_APART_S = 10.0
"""Images of a docking approach come faster."""


@dataclass(frozen=True)
class _Chunk:
    t: Vector
    spots: Stack
    control: Matrix
    quaternion: Matrix
    sigma: Stack


def filter_file(
    path: str | os.PathLike[str] | LogFile | TextTable,
    model: Model | str,
    out: str | os.PathLike[str] | None = None,
    *,
    method: str = "fix",
    projection: str | None = None,
    smooth: bool = False,
    engine: str = "compiled",
    progress: Callable[[int], None] | None = None,
    watch: Callable[[Solution], None] | None = None,
    frame: str = "lvlh_ccsds",
    orientation_deg: tuple[float, float, float] | None = None,
    writer: Writer = write_table,
) -> RunSummary:
    """Filter a log of spots from file to file; memory does not grow with the log.

    Parameters
    ----------
    path : str, path, LogFile or TextTable
        The log, as for `filter_log`, or one that is opened: a `LiveLog` is filtered as its rows come.
    model, method, projection, smooth, engine
        As for `filter_log`.
    out : str or path, optional
        The track, `.csv` or `.parquet`, as `write` writes it; whole or not at all.
    progress : callable, optional
        Called with the number of epochs just worked through; with `smooth` each counts three times.
    watch : callable, optional
        Called with every part of the solution, in order: for pictures, and for what else is gathered on the way.
    frame, orientation_deg
        Frame of the track's states, as for `Solution.in_frame`.
    writer : callable, optional
        What writes the track: the rows of an epoch are handed to it before the next epoch is asked for.

    Returns
    -------
    RunSummary
        What became of the epochs, with the reported sigma beside the published figures.

    Raises
    ------
    LogError, ModelError, UsageError
        As `filter_log` and `write`.
    """
    mission = load_mission(model) if isinstance(model, str) else model
    turning = Turning(frame, mission, orientation_deg)
    source = path if isinstance(path, LogFile | TextTable) else log_in_memory(path) or opened(Path(path))
    way: dict[str, Any] = {"method": method, "projection": projection, "smooth": smooth}
    whole: Solution | None = None
    if not isinstance(source, LogFile) and is_raw_log(source):
        refuse_raw(engine)
        whole = filter_raw_log(source, mission, **way)
    else:
        log = source if isinstance(source, LogFile) else LogFile(source)
        if says_exposures(log):
            refuse_late(engine)
            whole = filter_late_log(log, mission, **way)
    if whole is not None:
        if watch is not None:
            watch(whole)
        if out is not None:
            write(whole, out, frame=frame, orientation_deg=orientation_deg, model=mission)
        return _whole_summary(whole, mission)
    if smooth and engine != "compiled":
        raise UsageError(f'engine "{engine}" filters a file forward alone: leave smoothing out')
    check_beacons(log.path, log.columns.beacons, mission.name, len(mission.beacons_lvlh_m))
    run = _Run(log, LogFilter(mission, method, projection=projection, engine=engine), progress)
    summary = RunSummary(load_published(mission), mission.filter.gate_probability)
    summary.ignored = listed(log.columns.ignored)
    gathered = Gathered(summary.take)
    of_log = log_metadata(log.path, log.metadata, log.columns.ignored)

    def parts() -> Iterator[Table]:
        for solution in run.smoothed() if smooth else run.filtered():
            solution.metadata.update(of_log)
            yield rows_of(solution, turning(solution))
            gathered.take(solution)
            if watch is not None:
                watch(solution)

    if out is None:
        for _ in parts():
            pass
    else:
        stated = head(mission.name, method, smooth) | turning.stated
        stated |= lasting_words(mission, method) | engine_words(engine) | of_log
        writer(Path(out), COLUMNS, parts(), stated, INTEGERS)
    gathered.settle()
    summary.hint, summary.notes = run.hint(summary.started), run.notes()
    return summary


def _whole_summary(solution: Solution, model: Model) -> RunSummary:
    """Of a log that is filtered in memory: raw, or with images that change what came before them."""
    summary = RunSummary(load_published(model), model.filter.gate_probability)
    said = solution.metadata
    summary.ignored = said.get("ignored columns", "")
    summary.notes = spacing_note(solution.t_s)
    if "slots" in said:
        slots = (f"slots: {said['slots']}; spot noise {said['spot noise']}", f"beacons: {said['beacons']}")
        summary.notes = slots + summary.notes
    summary.take(solution)
    return summary


def refuse_raw(engine: str) -> None:
    """Refuse another engine for a raw log.

    Raises
    ------
    UsageError
        Saying what to do.
    """
    if engine != "compiled":
        raise UsageError(f'engine "{engine}" filters logs of spots, not raw ones of a detector: leave it out')


def refuse_late(engine: str) -> None:
    """Refuse another engine for a log whose images came late.

    Raises
    ------
    UsageError
        Saying what to do.
    """
    if engine != "compiled":
        raise UsageError(f'engine "{engine}" takes images at once: leave it out, or the log\'s image_t_s')


def engine_words(engine: str) -> dict[str, str]:
    """Which engine has made a track, for a reader: nothing of the usual one."""
    return {} if engine == "compiled" else {"engine": engine}


def spacing_note(t_s: Vector, what: str = "name the column t_ms") -> tuple[str, ...]:
    """A note where rows (of their first times) are so far apart, in whole numbers, that the unit is in doubt."""
    t = t_s[:ROWS_TRIED]
    apart = float(np.median(np.diff(t))) if len(t) > 2 else 0.0
    if apart < FAR_APART_S or not bool((t == np.rint(t)).all()):
        return ()
    return (f"rows are {apart:g} s apart: if the times are milliseconds, {what}",)


class _Run:
    """One log on its way through one filter."""

    def __init__(self, log: LogFile, log_filter: LogFilter, progress: Callable[[int], None] | None):
        self.log, self.filter, self.progress = log, log_filter, progress
        self._first: _Chunk | None = None

    def notes(self) -> tuple[str, ...]:
        """What is odd about the first rows: how far apart they are, and an attitude that comes in steps."""
        if self._first is None:
            return ()
        model = self.filter.model
        said = spacing_note(self._first.t) + rounded(self._first.spots, model.sensor.spot_noise_m, "um", 1e6)
        if self.filter.method == "spots" and len(self._first.quaternion) > 1:
            spot = model.sensor.spot_noise_m / model.sensor.focal_length_m
            said += stepped(turns_of(self._first.quaternion), model.attitude.noise_rad, spot)
        return said

    def hint(self, started: bool) -> str:
        """Why the filter did not start or rejects much, as far as the log's columns tell."""
        columns = self.log.columns
        if started or self._first is None:
            controlled = columns.has(ACCELERATION) or columns.has(DELTA_V)
            hint = "the log has no control columns (accel_x_m_s2, ...): if the chaser thrusts, add them"
            return "" if controlled else hint
        return reading_that_starts(self.filter, self._first.t, self._first.spots, self._first.quaternion)

    def _chunks(self) -> Iterator[_Chunk]:
        for piece in self.log.chunks():
            chunk = _chunk(piece)
            if self._first is None:
                self._first = _Chunk(*(array[:ROWS_TRIED] for array in vars(chunk).values()))
            yield chunk

    def _forward(self, chunk: _Chunk, *, smooth: bool) -> Epochs:
        epochs = self.filter.room(len(chunk.t), smooth=smooth)
        self.filter.forward(chunk.t, chunk.spots, chunk.control, chunk.quaternion, epochs, chunk.sigma)
        self._count(chunk.t)
        return epochs

    def _count(self, t: Vector) -> None:
        if self.progress is not None:
            self.progress(len(t))

    def filtered(self) -> Iterator[Solution]:
        """The log's epochs, filtered, chunk after chunk."""
        for chunk in self._chunks():
            epochs = self._forward(chunk, smooth=False)
            yield self.filter.solution(chunk.t, chunk.quaternion, epochs, smoothed=False)

    def smoothed(self) -> Iterator[Solution]:
        """The log's epochs, smoothed, chunk after chunk."""
        with Spool() as spool, Spool() as inputs:
            for chunk in self._chunks():
                one = self._forward(chunk, smooth=True)
                spool.append(one.state, one.factor, one.innovation, one.nis, one.codes, chunk.t, chunk.quaternion)
                inputs.append(chunk.control, one.considered)
            later = self.filter.nothing_later()
            for k in reversed(range(len(spool))):
                state, factor, innovation, nis, codes, t, _ = spool[k]
                control, considered = inputs[k]
                self.filter.backward(t, control, Epochs(state, factor, innovation, nis, codes, considered), later)
                spool.replace(k, state, factor)
                self._count(t)
            for k in range(len(spool)):
                state, factor, innovation, nis, codes, t, quaternion = spool[k]
                joined = np.empty((len(t), 0, MOTION))  # what is considered is in the factors now
                epochs = Epochs(state, factor, innovation, nis, codes, joined)
                yield self.filter.solution(t, quaternion, epochs, smoothed=True)
                self._count(t)


def _chunk(piece: Log) -> _Chunk:
    n = len(piece.t_s)
    control = controls(n, piece.acceleration_m_s2, piece.delta_v_m_s)
    quaternion = np.empty((0, 4)) if piece.q_cam_from_lvlh is None else piece.q_cam_from_lvlh
    sigma = np.empty((0, 0, 2)) if piece.spot_sigma_m is None else piece.spot_sigma_m
    return _Chunk(piece.t_s, piece.spots_m, control, quaternion, sigma)
