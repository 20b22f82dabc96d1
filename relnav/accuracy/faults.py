"""Is an estimate ever silently wrong: many approaches with faults that last, and what the filter said of them.

A run is silent where, for a second or more, the position is beyond five of its reported sigmas (in any axis) and
nothing was flagged within three seconds: no alarm, nothing rejected, no start that replaced a track. Of markers
(`marker_faults.py`) the attitude counts too. Sensors are flown
twice: as drawn, with the filter of published figures, which knows of noise (and of the attitude's sigma) alone; and
built within the model's tolerances, drawn once a run, which the filter considers.
"""

import dataclasses
import math
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.accuracy.campaign import SEED_STRIDE
from relnav.accuracy.statistics import wilson_bounds
from relnav.arrays import Codes, Flags, Matrix, Vector
from relnav.estimation.monitors import HOLD_S
from relnav.mission import Model
from relnav.navigation.log import filter_epochs
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, Alarm
from relnav.simulation.as_built import attitude_off, built
from relnav.simulation.detector import Faults, image, project_beacons
from relnav.simulation.lasting_faults import (
    ATTITUDE_RAD,
    FOCAL_LENGTH_SHARE,
    PLACED_M,
    REFLECTION_M,
    Fault,
    direction,
    end_of,
    faulty_sensor,
    with_fault,
)
from relnav.simulation.trajectory import Approach, fly

RUNS = 40
METHODS = ("fix", "spots")
SILENT_SHARE, FALSE_ALARM_SHARE = 0.02, 1 / 200
BEYOND_SIGMAS, SILENT_S, NEAR_S = 5.0, 1.0, 3.0
ATTITUDE_TOLD_RAD = math.radians(0.05)
FROM_S = (60.0, 230.0)
"""Between these a fault begins."""
DRAWN, BUILT, TOLD = "as drawn", "as built", "as built, error stated"
_UNSEEN = {Fault.FOCAL_LENGTH, Fault.PLACED}
NOT_OBSERVABLE = {(DRAWN, Fault.LATE), *((flown, fault) for flown in (DRAWN, BUILT) for fault in _UNSEEN)}
"""What images cannot tell (`docs/validation.md` proves it); told as a tolerance it is in the covariance."""


@dataclass(frozen=True)
class FaultRow:
    """Runs of one fault.

    Attributes
    ----------
    flown, fault, method : str
        As drawn or built, what goes wrong, and the measurement model.
    observable : bool
        Whether images can tell.
    runs, beyond, alarmed, silent : int
        How many; beyond five sigma for a second; with any alarm, but for RESTARTED after three seconds or more
        without a measurement; silently wrong.
    silent_low, silent_high : float
        95 % bounds of the silent share (Wilson).
    recovery_s, recovery_worst_s : float
        Median and longest time from the end of the fault until nothing is flagged or wrong any more; NaN if it stays.
    """

    flown: str
    fault: str
    method: str
    runs: int
    beyond: int
    alarmed: int
    silent: int
    silent_low: float
    silent_high: float
    recovery_s: float
    recovery_worst_s: float
    observable: bool

    @property
    def ok(self) -> bool:
        """Whether the goals are met: silent shares, and false alarms of healthy runs."""
        return not self._alarms_falsely and (not self.observable or self.silent <= SILENT_SHARE * self.runs)

    @property
    def may_be_chance(self) -> bool:
        """Whether so few runs would be silent by chance too, if the goal were met."""
        return not self._alarms_falsely and self.silent_low < SILENT_SHARE

    @property
    def _alarms_falsely(self) -> bool:
        return self.fault == Fault.HEALTHY and self.alarmed > max(1.0, FALSE_ALARM_SHARE * self.runs)


@dataclass(frozen=True)
class FaultsReport:
    """All rows, of one model."""

    model: str
    runs: int
    seed: int
    rows: tuple[FaultRow, ...]

    @property
    def ok(self) -> bool:
        """Whether every row meets its goal."""
        return all(row.ok for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        rows = [dataclasses.asdict(row) | {"ok": row.ok} for row in self.rows]
        return {"model": self.model, "runs": self.runs, "seed": self.seed, "ok": self.ok, "rows": rows}

    def lines(self) -> list[str]:
        """For a reader."""
        out = [
            f"model {self.model}, {self.runs} runs of 300 s a row, seed {self.seed}: persistent faults",
            "silent: 1 s or more beyond 5 sigma and nothing flagged within 3 s; recovery: median and longest",
        ]
        flown = ""
        for row in self.rows:
            if row.flown != flown:
                flown = row.flown
                out.append(f"{flown:<38}method  beyond  alarmed  silent  95 % bounds     recovery, s")
            bounds = f"{row.silent_low:.3f} .. {row.silent_high:.3f}"
            recovery = f"{row.recovery_s:5.1f} {row.recovery_worst_s:6.1f}" if row.recovery_s == row.recovery_s else ""
            verdict = "" if row.observable else "  not observable"
            verdict = verdict if row.ok else "  GOAL NOT MET"
            out.append(
                f"  {row.fault:<36}{row.method:<7}{row.beyond:>7}{row.alarmed:>9}{row.silent:>8}  {bounds}"
                f"  {recovery:<12}{verdict}".rstrip()
            )
        out.append("every goal is met" if self.ok else "SOME GOALS ARE NOT MET")
        if not self.ok and all(row.ok or row.may_be_chance for row in self.rows):
            out.append(f"with {self.runs} runs a row that may be chance: more runs (--runs 400) decide")
        return out


def told_model(model: Model, flown: str, fault: Fault) -> Model:
    """What the filter is told."""
    t = model.tolerances
    if t is None:
        raise ValueError(f"model {model.name} has no [tolerances]: what a built sensor may be like is not known")
    t = dataclasses.replace(t, considered=flown != DRAWN, distortion_limit_m=0.0)  # spots here have no distortion
    if flown == TOLD and fault == Fault.FOCAL_LENGTH:
        t = dataclasses.replace(t, focal_length_relative_sigma=FOCAL_LENGTH_SHARE)
    if flown == TOLD and fault == Fault.PLACED:
        t = dataclasses.replace(t, beacon_placement_sigma_m=PLACED_M / math.sqrt(3.0))
    attitude = model.attitude
    if fault == Fault.ATTITUDE:
        attitude = dataclasses.replace(attitude, sigma_rad=ATTITUDE_TOLD_RAD)
    return dataclasses.replace(model, tolerances=t, attitude=attitude)


@dataclass(frozen=True)
class Verdict:
    """What became of a run; as in `FaultRow`."""

    beyond: bool
    alarmed: bool
    silent: bool
    recovery_s: float


def run_once(model: Model, flown: str, fault: Fault, seed: int) -> tuple[Verdict, ...]:
    """One flight with a fault, judged for each method."""
    told, rng = told_model(model, flown, fault), np.random.default_rng([seed, list(Fault).index(fault)])
    assert told.tolerances is not None
    draws, theta = rng.normal(size=7 + told.sensor.beacons_dock_m.size), rng.normal(size=3)
    real = built(told, told.tolerances, draws * (flown != DRAWN))
    real = attitude_off(real, theta * told.attitude.sigma_rad * (flown != DRAWN))
    real = faulty_sensor(real, fault, rng)
    if fault == Fault.ATTITUDE:
        real = attitude_off(real, ATTITUDE_RAD * direction(rng, 3))
    start = (10.0, float(rng.uniform(-0.4, 0.4)), float(rng.uniform(-0.4, 0.4)))
    thrust = float(rng.normal()) * told.process_noise.control_magnitude_sigma
    approach = Approach(
        start_m=start,
        final_range_m=4.2,
        thrust_scale_error=thrust,
        assumed_noise=True,
        assumed_start=fault == Fault.HEALTHY,  # a velocity that the filter does not know
    )
    t, truth, command = fly(told, approach, rng)
    from_s = float(rng.uniform(*FROM_S))
    spots, last, noise = image(real, truth, Faults(), rng), project_beacons(real, truth)[:, 2], real.sensor.spot_noise_m
    t_log, spots = with_fault(t, spots, fault, from_s, noise, last, REFLECTION_M, rng)
    out = []
    for method in METHODS:
        track = filter_epochs(told, t_log, spots, acceleration_m_s2=command, method=method)
        error, end_s = (track.state - truth)[:, :3], end_of(fault, from_s)
        out.append(judge(t, error, track.sigma[:, :3], track.alarm, track.status, end_s))
    return tuple(out)


def _longest(flags: Flags) -> int:
    edges = np.diff(np.concatenate([[0], flags.astype(np.int64), [0]]))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return int((ends - begins).max()) if len(begins) else 0


def _found_again(status: Codes, rate: float) -> Flags:
    """Epochs for which RESTARTED is said of a start after `NEAR_S` or more without a measurement."""
    out, held, unseen = np.zeros(len(status), dtype=bool), round(HOLD_S * rate) + 1, np.cumsum(status == PREDICTED)
    for start in np.flatnonzero(status == STARTED):
        used = np.flatnonzero(np.isin(status[:start], (UPDATED, PARTIAL, STARTED)))
        if len(used) and unseen[start] - unseen[used[-1]] >= NEAR_S * rate:
            out[start : start + held] = True
    return out


def judge(t: Vector, error: Matrix, sigma: Matrix, alarm: Codes, status: Codes, end_s: float) -> Verdict:
    """Judge a track's errors (n, k) at the true times of its images (n,); NaN: no state."""
    known = np.isfinite(error[:, 0])
    beyond = known & (np.abs(error) > BEYOND_SIGMAS * sigma).any(axis=1)
    flagged = (alarm != 0) | np.isin(status, (PARTIAL, REJECTED, STARTED))
    flagged[: int(np.argmax(known)) + 1] = False
    rate = 1.0 / float(t[1] - t[0])
    reach = round(NEAR_S * rate)
    near = np.convolve(flagged, np.ones(2 * reach + 1), "same") > 0
    late = t > end_s
    bad = np.flatnonzero(late & (beyond | (alarm != 0)))
    recovery = math.nan if math.isnan(end_s) else (float(t[bad[-1]]) - end_s if len(bad) else 0.0)
    return Verdict(
        beyond=_longest(beyond) >= SILENT_S * rate,
        alarmed=bool((alarm & np.where(_found_again(status, rate), ~int(Alarm.RESTARTED), -1)).any()),
        silent=_longest(beyond & ~near) >= SILENT_S * rate,
        recovery_s=recovery,
    )


def measure_faults(
    model: Model, *, runs: int = RUNS, seed: int = 7, progress: Callable[[int], None] | None = None
) -> FaultsReport:
    """Fly `runs` approaches for every fault, sensors as drawn and as built, and judge both methods.

    Raises
    ------
    ValueError
        For fewer than two runs, or a model without tolerances.
    """

    def once(flown: str, fault: Fault, seed: int) -> tuple[Verdict, ...]:
        return run_once(model, flown, fault, seed)

    rows = fly_faults(cases(), once, METHODS, NOT_OBSERVABLE, {}, runs, seed, progress)
    return FaultsReport(model.name, runs, seed, rows)


def fly_faults(
    cases: list[tuple[str, Fault]],
    once: Callable[[str, Fault, int], tuple[Verdict, ...]],
    methods: tuple[str, ...],
    not_observable: Container[tuple[str, Fault]],
    names: Mapping[Fault, str],
    runs: int,
    seed: int,
    progress: Callable[[int], None] | None,
) -> tuple[FaultRow, ...]:
    """A row for each way to fly with a fault, and each method: `once` gives the verdicts of a run, one a method.

    names: of faults that are called otherwise here.

    Raises
    ------
    ValueError
        For fewer than two runs.
    """
    if runs < 2:
        raise ValueError(f"runs must be 2 or more; got {runs}")
    rows: list[FaultRow] = []
    for flown, fault in cases:
        verdicts = []
        for run in range(runs):
            verdicts.append(once(flown, fault, seed * SEED_STRIDE + run))
            if progress is not None:
                progress(1)
        for k, method in enumerate(methods):
            observable, name = (flown, fault) not in not_observable, names.get(fault, fault.value)
            rows.append(_row_of(flown, name, method, [verdict[k] for verdict in verdicts], observable))
    return tuple(rows)


def cases() -> list[tuple[str, Fault]]:
    """Every way to fly with every fault."""
    return [
        *((flown, fault) for flown in (DRAWN, BUILT) for fault in Fault),
        (TOLD, Fault.FOCAL_LENGTH),
        (TOLD, Fault.PLACED),
    ]


def _row_of(flown: str, fault: str, method: str, verdicts: list[Verdict], observable: bool) -> FaultRow:
    """What became of all runs of a fault."""
    silent, recovery = sum(v.silent for v in verdicts), np.array([v.recovery_s for v in verdicts])
    low, high = wilson_bounds(silent, len(verdicts))
    return FaultRow(
        flown=flown,
        fault=fault,
        method=method,
        runs=len(verdicts),
        beyond=sum(v.beyond for v in verdicts),
        alarmed=sum(v.alarmed for v in verdicts),
        silent=silent,
        silent_low=low,
        silent_high=high,
        recovery_s=float(np.median(recovery)),
        recovery_worst_s=float(np.max(recovery)),
        observable=observable,
    )
