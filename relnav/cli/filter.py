"""`relnav filter`: a log of spots in, a track with covariance out, and a summary beside the published figures."""

import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from relnav.accuracy.published import Comparison
    from relnav.navigation.record import Solution

BAR_FROM_BYTES = 5_000_000
PLAIN_BELOW_BYTES = 1_000_000
"""About 12,000 epochs: 4 to 8 s in plain Python, against 20 s of compilation."""


@click.command(epilog="Example: relnav filter approach.csv --model three_beacon_psd --out track.csv")
@click.argument("log", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--model", required=True, help="A shipped model (see `relnav models`), a folder or a model.toml.")
@click.option(
    "--method",
    type=click.Choice(["spots", "fix"]),
    default="spots",
    show_default=True,
    help="Measurement model: the spots themselves, or the closed form's range, azimuth and elevation.",
)
@click.option(
    "--projection",
    type=click.Choice(["perspective", "parallel"]),
    help="Closed form: exact for real optics, or as printed in the paper. Default: the model's.",
)
@click.option("--smooth", is_flag=True, help="Run backward too: every state then rests on all measurements.")
@click.option("--out", type=click.Path(path_type=Path), help="Track to write, .csv or .parquet.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the summary as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    log: Path,
    model: str,
    method: str,
    projection: str | None,
    smooth: bool,
    out: Path | None,
    json_path: Path | None,
    quiet: bool,
) -> None:
    """Filter the spots of LOG (CSV or Parquet, one row an epoch) into range, azimuth, elevation and a relative state.

    Columns of LOG: t_s; spot_a_x_um, spot_a_y_um, spot_b_..., spot_c_... (any length unit; empty = not seen);
    optionally accel_{x,y,z}_m_s2, delta_v_{x,y,z}_m_s (lvlh_ccsds), q_cam_from_lvlh_{x,y,z,w}. A raw log of a detector
    (CSV, one row a slot) has t_s, beacon (a, b, c or dark), and adc_{x1,x2,y1,y2} or current_{x1,x2,y1,y2}_na instead
    of spots; every spot then enters the filter at its own time.
    """
    _choose_engine(log)
    from relnav.accuracy.published import compare_with_published
    from relnav.files.atomic import check_distinct, check_folder, replacing
    from relnav.files.models import load_mission, load_published
    from relnav.files.tables import check_format, write, write_json

    if out is not None:
        check_format(out)
        check_folder(out)
    if json_path is not None:
        check_folder(json_path)
    check_distinct(log, out, json_path)
    mission = load_mission(model)
    published = load_published(mission)
    solution = _filter(log, mission, method, projection, smooth, show_bar=not quiet and sys.stderr.isatty())
    comparisons = compare_with_published(solution, published)
    gate = mission.filter.gate_probability
    with ExitStack() as outputs:  # all files appear together at its end, or none
        if out is not None:
            write(solution, outputs.enter_context(replacing(out)))
        if json_path is not None:
            write_json(summary(solution, comparisons, gate), outputs.enter_context(replacing(json_path)))
        if not quiet:
            for line in summary_lines(log.name, solution, comparisons, gate):
                click.echo(line)
            if out is not None:
                click.echo(f"track: {out}")


def _choose_engine(log: Path) -> None:
    """Run a short log as plain Python where nothing is compiled yet: 2 s instead of 20 s, and the same track."""
    if "RELNAV_JIT" in os.environ or "relnav._kernel" in sys.modules or log.stat().st_size >= PLAIN_BELOW_BYTES:
        return
    from relnav._cache import compiled_code_at_hand

    if not compiled_code_at_hand():
        os.environ["RELNAV_JIT"] = "0"


def _filter(log: Path, mission: Any, method: str, projection: str | None, smooth: bool, show_bar: bool) -> "Solution":
    from relnav.files.filter_log import filter_log

    if not show_bar or log.stat().st_size < BAR_FROM_BYTES:
        return filter_log(log, mission, method=method, projection=projection, smooth=smooth)
    with click.progressbar(length=1, label="filtering", file=sys.stderr) as bar:

        def progress(done: int, total: int) -> None:
            bar.length = total
            bar.update(done)

        return filter_log(log, mission, method=method, projection=projection, smooth=smooth, progress=progress)


def summary(solution: "Solution", comparisons: "tuple[Comparison, ...]", gate_probability: float) -> dict[str, Any]:
    """The figures of a run as plain values."""
    from relnav.navigation.status import EpochStatus

    counts = {status.name.lower(): int((solution.status == status).sum()) for status in EpochStatus}
    nis = solution.nis_consistency()
    seen = solution.dof > 0
    refused = counts["partial"] + counts["rejected"]
    chance = 3.0 * (1.0 - gate_probability) * int(seen.sum())
    started = solution.t_s[solution.status == EpochStatus.STARTED]
    return {
        "model": solution.model,
        "method": solution.method,
        "smoothed": solution.smoothed,
        "epochs": len(solution),
        "t_first_s": float(solution.t_s[0]),
        "t_last_s": float(solution.t_s[-1]),
        "started_s": float(started[0]) if len(started) else None,
        "restarts": solution.restarts,
        "epochs_by_status": counts,
        "accepted": int(solution.accepted.sum()),
        "nis_per_dof": nis.ratio,
        "nis_interval": [nis.lower, nis.upper],
        "nis_consistent": nis.consistent,
        "nis_all_per_dof": float(solution.nis[seen].sum() / max(1, solution.dof[seen].sum())),
        "refused_unexplained": bool(solution.restarts or refused > chance + 5.0 * chance**0.5 + 3.0),
        "rows": [
            {
                "quantity": row.claim.quantity,
                "published": row.claim.value,
                "unit": row.claim.unit,
                "statistic": row.claim.statistic,
                "sigma_at_end": row.sigma,
                "ratio": row.ratio,
                "met_from_s": row.met_from_s,
            }
            for row in comparisons
        ],
    }


def summary_lines(
    log: str, solution: "Solution", comparisons: "tuple[Comparison, ...]", gate_probability: float
) -> list[str]:
    """The figures of a run for a reader."""
    from relnav.navigation.status import EpochStatus
    from relnav.sensors.measurement import Status

    figures = summary(solution, comparisons, gate_probability)
    counts = figures["epochs_by_status"]
    first, last = figures["t_first_s"], figures["t_last_s"]
    method = solution.method + (", smoothed" if solution.smoothed else "")
    lines = [f"{log}: {len(solution)} epochs, {first:.12g} s to {last:.12g} s; model {solution.model}, method {method}"]
    if "ignored columns" in solution.metadata:
        lines.append(f"ignored columns: {solution.metadata['ignored columns']}")
    if "slots" in solution.metadata:
        lines.append(f"slots: {solution.metadata['slots']}; spot noise {solution.metadata['spot noise']}")
        lines.append(f"beacons: {solution.metadata['beacons']}")
    if figures["started_s"] is None:
        reasons = solution.measurement_status
        names = [f"{Status(int(code)).name} {int((reasons == code).sum())}" for code in sorted(set(reasons.tolist()))]
        lines.append(f"NOT STARTED: no epoch was confirmed by the next; measurements by outcome: {', '.join(names)}")
        if (reasons == Status.SWAPPED).any():
            lines.append("  SWAPPED: the image is upside down for the stated attitude; are beacons A and B exchanged?")
        return lines
    lines.append(
        f"started at {figures['started_s']:.12g} s, restarts {solution.restarts}; "
        f"epochs used whole {figures['accepted']}, in part {counts['partial']}, rejected {counts['rejected']}, "
        f"without a measurement {counts['predicted']}, without a state {counts['waiting']}"
    )
    lines.append(f"{solution.nis_consistency()} (epochs used whole)")
    refused = counts["partial"] + counts["rejected"]
    if figures["refused_unexplained"]:
        lines.append(
            f"  BUT {refused} epochs had spots rejected, more than the gate alone explains, and restarts are "
            f"{solution.restarts}; NIS of all that was seen: {figures['nis_all_per_dof']:.3g} per degree of freedom"
        )
    if solution.status[-1] == EpochStatus.WAITING:
        lines.append("  THE TRACK IS LOST at the end of the log: its uncertainty outgrew the range")
    if comparisons:
        known = solution.t_s[solution.status != EpochStatus.WAITING]
        lines.append(f"1-sigma at {known[-1]:.12g} s   reported    published   ratio   within it from")
        for row in comparisons:
            since = f"{row.met_from_s:.12g} s" if row.met_from_s == row.met_from_s else "never"
            value = f"{row.sigma:.5f} {row.claim.unit}"
            claim = f"{row.claim.value:g} {row.claim.unit}"
            lines.append(f"  {row.claim.quantity:<16}{value:>12}{claim:>13}{row.ratio:>8.3f}   {since}")
    return lines
