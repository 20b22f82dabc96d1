"""`relnav campaign`: many approaches of a scenario, with progress, summary and pictures; here or on a cluster."""

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.completion import FLOWN, ModelName
from relnav.cli.printing import say

if TYPE_CHECKING:
    from relnav.accuracy.campaign_plan import Plan


@click.command(
    epilog="Example: relnav campaign three_beacon_psd --runs 1000 --seed 7 --scenario vbar.toml --out campaign"
)
@click.argument("model", type=ModelName(*FLOWN))
@click.option("--runs", required=True, type=click.IntRange(min=1), help="Number of approaches.")
@click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(min=0), help="The same seed, the same figures."
)
@click.option(
    "--out", required=True, type=click.Path(path_type=Path), help="Folder; part of this campaign in it is kept."
)
@click.option(
    "--scenario", "scenario_path", type=click.Path(path_type=Path), help="What is flown and what is uncertain."
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace a value of MODEL, or of the scenario (approach.speed_mm_s=20); as often as you like.",
)
@click.option("--method", type=click.Choice(["fix", "spots"]), help="Of a beacon filter; fix if left out.")
@click.option("--workers", type=click.IntRange(min=1), help="Threads or processes; the processors at hand if left out.")
@click.option(
    "--cluster",
    metavar="ADDRESS",
    help="A dask scheduler, as in tcp://10.0.0.5:8786; local: processes of this machine; slurm: print a job script.",
)
@click.option(
    "--only", type=click.IntRange(min=0), metavar="RUN", help="Fly one run, and write its log, truth and row."
)
@click.option(
    "--pictures", default="png", show_default=True, type=click.Choice(["png", "pdf", "svg"]), help="Kind of pictures."
)
@click.option(
    "--sensitivities",
    is_flag=True,
    help="Sensitivity analysis of the final error instead; RUNS, a power of two, is flown for each cause.",
)
@click.option("--no-pictures", is_flag=True, help="Draw nothing.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    model: str,
    runs: int,
    seed: int,
    out: Path,
    scenario_path: Path | None,
    settings: tuple[str, ...],
    method: str | None,
    workers: int | None,
    cluster: str | None,
    only: int | None,
    pictures: str,
    sensitivities: bool,
    no_pictures: bool,
    quiet: bool,
) -> None:
    """Fly, filter and score many approaches of MODEL, each with random numbers of its own.

    MODEL: a three_beacon or three_marker mission, or a vehicle.

    The folder holds campaign.json (what is flown), runs/ (Parquet, one row per run), summary.json, pictures, and
    failed.parquet if runs failed. The same command resumes a campaign that was stopped. The results do not depend on
    workers, cluster or interruptions. See docs/campaign.md.
    """
    from relnav.cli.settings import model_and_scenario
    from relnav.errors import InputError, UsageError
    from relnav.files.campaign import finish, fly_missing, plan_of
    from relnav.files.models import load_model
    from relnav.files.scenarios import load_scenario
    from relnav.files.sensitivities import finish_study, study_of

    if cluster == "slurm":
        from relnav.files.cluster import job_script

        say(job_script(workers, _without_cluster(sys.argv[1:])).splitlines())
        return
    of_model, of_scenario = model_and_scenario(settings)
    loaded = load_model(model, of_model)
    try:
        plan = plan_of(loaded, load_scenario(scenario_path, of_scenario, model=loaded), method, seed, runs)
        plan = study_of(plan) if sensitivities else plan
    except InputError:
        raise
    except ValueError as error:
        raise UsageError(str(error)) from error
    if only is not None:
        lines = _one_run(plan, only, out)
    else:
        if plan.note and not quiet:
            click.echo(f"note: {plan.note}", err=True)
        with _Progress(plan, out, quiet) as progress:
            fly_missing(plan, out, workers, cluster, progress.done)
        kind = None if no_pictures else pictures
        found = finish_study(plan, out, pictures=kind) if sensitivities else finish(plan, out, pictures=kind)
        lines = found.lines()
        lines.append(f"results: {out}")
    if not quiet:
        say(lines)


def _one_run(plan: "Plan", run: int, out: Path) -> list[str]:
    """Write log, truth and figures of one run, in files of its own."""
    from relnav.accuracy.campaign_plan import fly_batch
    from relnav.accuracy.run_figures import RunStatus
    from relnav.cli.simulators import simulated_run
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs
    from relnav.files.tables import write_json

    if run >= plan.runs:
        raise UsageError(f"--only {run}: the campaign has runs 0 to {plan.runs - 1}")
    batch = fly_batch(plan, range(run, run + 1))
    status, reason = RunStatus(int(batch.status[0])), batch.reasons[0]
    row: dict[str, Any] = {"run": run, "status": status.name, "reason": reason}
    row |= dict(zip(plan.columns, batch.figures[0].tolist(), strict=True))
    out.mkdir(parents=True, exist_ok=True)
    names = [out / f"run-{run}{ending}" for ending in (".json", "-log.csv", "-truth.csv")]
    with Outputs() as outputs:
        write_json(row, outputs.path(names[0]))
        if status != RunStatus.FAILED:
            simulated = simulated_run(plan.model, plan.scenario, plan.seed, run)
            metadata = {"model": plan.model.name, "seed": str(plan.seed), "run": str(run)}
            simulated.write_log(outputs.path(names[1]), metadata)
            simulated.write_truth(outputs.path(names[2]), metadata)
    return [f"run {run}: {status.name}{f', {reason}' if reason else ''}; {out / f'run-{run}'}*"]


def _without_cluster(arguments: list[str]) -> list[str]:
    """The words of this command line without --cluster and --workers, which the job script sets."""
    kept: list[str] = []
    skip = False
    for word in arguments:
        if skip:
            skip = False
        elif word in ("--cluster", "--workers"):
            skip = True
        elif not word.startswith(("--cluster=", "--workers=")):
            kept.append(word)
    return kept


class _Progress:
    """A bar with rate and time left on a terminal; elsewhere a line a minute."""

    PERIOD_S = 60.0

    def __init__(self, plan: "Plan", out: Path, quiet: bool) -> None:
        from relnav.files.campaign_folder import missing, open_folder

        open_folder(out, plan)
        self._plan, self._out, self._all = plan, out, plan.runs
        self._left = sum(len(plan.runs_of(start)) for start in missing(out, plan))
        self._quiet, self._flown, self._began, self._said = quiet, 0, time.monotonic(), time.monotonic()
        self._bar: Any = click.progressbar(
            length=self._all,
            label=f"{self._all} approaches",
            file=sys.stderr,
            hidden=quiet or not sys.stderr.isatty(),
            show_eta=True,
            item_show_func=lambda _: self._rate(),
        )

    def __enter__(self) -> "_Progress":
        self._bar.__enter__()
        self._bar.update(self._all - self._left)
        return self

    def __exit__(self, *error: Any) -> None:
        from relnav.files.atomic import IN_PLACE
        from relnav.files.campaign_folder import RUNS, missing

        self._bar.__exit__(*error)
        written = IN_PLACE.get()
        if error[0] is not None and written is not None:
            parts = len(self._plan.starts)
            there = parts - len(missing(self._out, self._plan))
            written[:] = [name for name in written if not name.endswith(".parquet")]  # told as a number
            written.append(f"{there} of {parts} parts in {self._out / RUNS}; the same command goes on")

    def done(self, runs: int) -> None:
        """So many more runs are flown."""
        self._flown += runs
        self._bar.update(runs)
        now = time.monotonic()
        if not (self._quiet or sys.stderr.isatty()) and now - self._said >= self.PERIOD_S:
            self._said = now
            left = (self._left - self._flown) * (now - self._began) / self._flown
            click.echo(
                f"{self._all - self._left + self._flown} of {self._all} approaches, {self._rate()}, {left:.0f} s left",
                err=True,
            )

    def _rate(self) -> str:
        took = time.monotonic() - self._began
        return f"{self._flown / took:.1f} a second" if self._flown and took > 0.0 else ""
