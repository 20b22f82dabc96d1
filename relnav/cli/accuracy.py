"""`relnav accuracy`: what a sensor system reaches, beside what its paper claims."""

import math
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.approach_report import closing_line, compared, report_lines
from relnav.cli.completion import ModelName
from relnav.cli.printing import OutputPath, say

if TYPE_CHECKING:
    from relnav.accuracy.claims import ClaimsReport

DIED = "a process that flew runs died, as where memory is short; on one processor all is flown in one process"
DRAWN = ("relnav.mission:Model", "relnav.spacecraft:Vehicle")
"""Missions of which there is a picture."""


@click.command(epilog="Example: relnav accuracy three_beacon_psd --runs 20 --json accuracy.json --plot accuracy.png")
@click.argument("model", type=ModelName())
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace a value of MODEL, and compare that design with the same published figures; as often as you like.",
)
@click.option("--runs", type=click.IntRange(min=2), help="Simulated runs; the system's own number if left out.")
@click.option(
    "--seed", default=7, show_default=True, type=click.IntRange(min=0), help="The same seed, the same report."
)
@click.option("--json", "json_path", type=OutputPath(), help="Write the report as one JSON object.")
@click.option(
    "--plot", type=OutputPath(), help="Draw errors and 1-sigma over range, of beacons or a vehicle: .png, .pdf, .svg."
)
@click.option(
    "--faults",
    is_flag=True,
    help="Persistent faults of beacons, markers or a vehicle: how often the estimate is silently wrong.",
)
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    model: str,
    settings: tuple[str, ...],
    runs: int | None,
    seed: int,
    json_path: Path | None,
    plot: Path | None,
    faults: bool,
    quiet: bool,
) -> int:
    """Compare MODEL with simulated truth and with its paper: single images, filters and smoothers of a mission.

    Truth is integrated on two-body orbits with the white acceleration that the filter assumes. Exit code 0: every row
    is as the model's published.toml expects; 1: some are not, or there is no published.toml to compare with.
    Keys of --set are those of the model's file, in any fitting unit: focal_length_mm=80, or sensor.focal_length_mm=80.
    """
    from relnav.accuracy.claims import ClaimsReport
    from relnav.cli import NOT_MET
    from relnav.cli.settings import setting
    from relnav.errors import UsageError
    from relnav.files.accuracy import measure_accuracy
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.models import load_model
    from relnav.files.picture_style import check_picture
    from relnav.files.systems import system_of
    from relnav.files.tables import write_json

    for path in (json_path, plot):
        if path is not None:
            check_folder(path)
    if plot is not None:
        check_picture(plot)
    check_distinct(json_path, plot)
    change = " ".join(settings)
    mission = load_model(model, dict(setting(text) for text in settings))
    system = system_of(mission)
    if faults:
        return _faults(mission, change, runs, seed, json_path, plot, quiet)
    if plot is not None and system.mission not in DRAWN:
        raise UsageError(f"--plot draws missions of beacons and vehicles; {mission.name} has no picture")
    count = system.runs if runs is None else runs
    with click.progressbar(
        length=system.progress_steps * count,
        label=f"{count} runs" + (f", {system.progress_steps} times" if system.progress_steps > 1 else ""),
        file=sys.stderr,
        hidden=quiet or not sys.stderr.isatty(),
    ) as bar:
        report = measure_accuracy(mission, runs=count, seed=seed, progress=bar.update)
    with Outputs() as outputs:
        if json_path is not None:
            write_json(report.to_dict() | {"change": change}, outputs.path(json_path))
        if plot is not None:
            _draw(report, outputs.path(plot, ".png"))
    if not quiet:
        lines = claim_lines(report) if isinstance(report, ClaimsReport) else report_lines(report)
        say([*_changed(change), *lines], json_path, plot)
    return 0 if report.ok and compared(report) else NOT_MET


def _draw(report: Any, path: Path) -> None:
    """The picture of a mission of beacons or of a vehicle."""
    from relnav.accuracy.rendezvous import VehicleReport

    if isinstance(report, VehicleReport):
        from relnav.files.vehicle_accuracy_picture import draw_vehicle_accuracy

        draw_vehicle_accuracy(report, path)
    else:
        from relnav.files.pictures import draw_accuracy

        draw_accuracy(report, path)


def _changed(change: str) -> list[str]:
    """The line that says which design was flown, where it is not that of the file."""
    return [f"changed: {change}"] if change else []


def _faults(
    mission: Any, change: str, runs: int | None, seed: int, json_path: Path | None, plot: Path | None, quiet: bool
) -> int:
    """Faults that last; exit code 1 if a goal is not met."""
    from relnav.accuracy import faults, marker_faults, vehicle_fault_flights, vehicle_faults
    from relnav.cli import NOT_MET
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs
    from relnav.files.tables import write_json
    from relnav.mission import Model, VisionMission
    from relnav.spacecraft import Vehicle

    if plot is not None:
        raise UsageError("--faults has no picture; leave --plot out")
    cases: Sequence[object]
    measure: Callable[..., Any]
    if isinstance(mission, Vehicle):
        from relnav.files.workers import in_processes, processors

        fly_all = partial(in_processes, count=processors(), needs=mission, advice=DIED)
        cases, usual = vehicle_fault_flights.cases(mission), vehicle_faults.RUNS
        measure = partial(vehicle_faults.measure_faults, fly_all=fly_all)
    elif isinstance(mission, Model) and mission.tolerances is not None:
        cases, usual, measure = faults.cases(), faults.RUNS, faults.measure_faults
    elif isinstance(mission, VisionMission) and mission.tolerances is not None:
        cases, usual, measure = marker_faults.cases(), faults.RUNS, marker_faults.measure_faults
    else:
        raise UsageError(
            f"--faults flies a mission of beacons or markers with [tolerances], or a vehicle; {mission.name} is none"
        )
    count = usual if runs is None else runs
    with click.progressbar(
        length=len(cases) * count,
        label=f"{count} runs of {len(cases)} cases",
        file=sys.stderr,
        hidden=quiet or not sys.stderr.isatty(),
    ) as bar:
        report = measure(mission, runs=count, seed=seed, progress=bar.update)
    with Outputs() as outputs:
        if json_path is not None:
            write_json(report.to_dict() | {"change": change}, outputs.path(json_path))
    if not quiet:
        say([*_changed(change), *report.lines()], json_path)
    return 0 if report.ok else NOT_MET


def claim_lines(report: "ClaimsReport") -> list[str]:
    """A report of claims for a reader."""
    lines = [f"model {report.model}, {report.runs} runs, seed {report.seed}"]
    method = ""
    for row in report.rows:
        if row.method != method:
            method = row.method
            lines.append(method)
        published = "-" if math.isnan(row.published) else f"{row.published:g}"
        verdict = ("met" if row.met else "not met") + ("" if row.as_expected else f", EXPECTED {row.expected}")
        if math.isnan(row.published) and row.as_expected:
            verdict = "for information"
        lines.append(
            f"  {row.quantity:<28} published {published:>8}, measured {row.measured:10.4g} {row.unit} "
            f"({row.statistic}; {row.condition})  {verdict}"
        )
        if not row.met:
            lines.append(f"      {row.reason}")
    lines.extend(f"note: {note}" for note in report.notes)
    lines.append(closing_line(report))
    return lines
