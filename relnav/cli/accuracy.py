"""`relnav accuracy`: what a mission's sensor and filter reach, beside what its paper claims."""

import math
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from relnav.accuracy.report import AccuracyReport


@click.command(epilog="Example: relnav accuracy three_beacon_psd --runs 20 --json accuracy.json --plot accuracy.png")
@click.argument("model")
@click.option("--runs", default=200, show_default=True, type=click.IntRange(min=2), help="Simulated approaches.")
@click.option(
    "--seed", default=7, show_default=True, type=click.IntRange(min=0), help="The same seed, the same report."
)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the report as one JSON object.")
@click.option("--plot", type=click.Path(path_type=Path), help="Draw errors and 1-sigma over range, .png.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(model: str, runs: int, seed: int, json_path: Path | None, plot: Path | None, quiet: bool) -> int:
    """Measure single shots, filters and smoothers of MODEL against truth and against its paper.

    Truth is integrated on two-body orbits with the white acceleration that the filter assumes. Exit code 0: every row
    came out as the model's published.toml expects; 1: some did not.
    """
    from relnav.files.accuracy import measure_accuracy
    from relnav.files.atomic import check_distinct, check_folder, replacing
    from relnav.files.models import load_model
    from relnav.files.tables import write_json

    for path in (json_path, plot):
        if path is not None:
            check_folder(path)
    check_distinct(json_path, plot)
    mission = load_model(model)
    with click.progressbar(
        length=3 * runs,
        label=f"{runs} approaches, three times",
        file=sys.stderr,
        hidden=quiet or not sys.stderr.isatty(),
    ) as bar:
        report = measure_accuracy(mission, runs=runs, seed=seed, progress=bar.update)
    with ExitStack() as outputs:
        if json_path is not None:
            write_json(report.to_dict(), outputs.enter_context(replacing(json_path)))
        if plot is not None:
            from relnav.files.pictures import draw_accuracy

            draw_accuracy(report, outputs.enter_context(replacing(plot)))
        if not quiet:
            for line in report_lines(report):
                click.echo(line)
    return 0 if report.ok else 1


def report_lines(report: "AccuracyReport") -> list[str]:
    """The report for a reader."""
    lines = [f"model {report.model}, {report.runs} approaches, seed {report.seed}; errors against truth, rms"]
    method = ""
    for row in report.rows:
        if row.method != method:
            method = row.method
            lines.append(method)
            lines.append("    range   quantity     published      rms      bias   1-sigma   99.73 %  within 1s / 3s")
        verdict = ("met" if row.met else "not met") + ("" if row.as_expected else f", EXPECTED {row.expected}")
        within = f"{row.coverage_1:.3f} / {row.coverage_3:.4f}"
        lines.append(
            f"  {row.range_m:5.2f} m   {row.quantity:<9} {row.published:8g} {row.unit:<3} {row.measured:9.5f} "
            f"{row.bias:9.5f} {row.sigma:9.5f} {row.three_sigma:9.5f}  {within}  {verdict}"
        )
    lines.append("consistency, state NEES over runs, epoch by epoch (honest: 95 % of epochs inside the 95 % band)")
    for entry in report.consistency:
        verdict = ("not overconfident" if entry.one_sided else "consistent") if entry.consistent else "NOT consistent"
        if entry.consistent != entry.expected_consistent:
            verdict += ", NOT EXPECTED"
        nees = entry.nees
        lines.append(
            f"  {entry.method:<44} mean {nees.mean:7.2f} of {nees.dof}, inside 95 %: {nees.inside_95:.3f}, "
            f"outside 99.99 %: {nees.outside_9999:.4f}; NIS/dof {entry.nis.ratio:.4f} of [{entry.nis.lower:.4f}, "
            f"{entry.nis.upper:.4f}]  {verdict}"
        )
    lines.extend(f"    {row.method}: {row.reason}" for row in report.consistency if not row.expected_consistent)
    lines.append("settled filter on the docking axis, 1-sigma: Riccati equation | the filter itself after a long hold")
    for place in report.settled:
        riccati = (place.sigma_range_m, math.degrees(place.sigma_azimuth_rad), math.degrees(place.sigma_elevation_rad))
        itself = (
            place.reached_range_m,
            math.degrees(place.reached_azimuth_rad),
            math.degrees(place.reached_elevation_rad),
        )
        pairs = [f"{one:.5f} | {two:.5f}" for one, two in zip(riccati, itself, strict=True)]
        worst = place.observability[-1] / place.observability[0]
        lines.append(
            f"  {place.method:<6} {place.range_m:5.2f} m   range {pairs[0]} m, azimuth {pairs[1]} deg, "
            f"elevation {pairs[2]} deg; observability {worst:.1e}"
        )
    if not report.rows:
        lines.append("no published.toml stands beside this model: nothing to compare with")
    lines.append("every row came out as expected" if report.ok else "SOME ROWS DID NOT COME OUT AS EXPECTED")
    return lines
