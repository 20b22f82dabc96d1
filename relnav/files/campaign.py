"""Campaigns: many approaches of a scenario, flown, filtered and summed up; on threads here, or on a cluster."""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.accuracy.campaign_summary import CampaignSummary, summarise
from relnav.arrays import whole
from relnav.files.campaign_folder import Runs, missing, open_folder, table_of, write_batch, write_failed
from relnav.files.models import load_model, load_published
from relnav.files.parquet import require_pyarrow
from relnav.files.paths import path_of
from relnav.files.scenarios import load_scenario
from relnav.files.tables import write_json
from relnav.simulation.dispersions import Scenario

SUMMARY, ERRORS_PICTURE, FINAL_PICTURE = "summary.json", "errors_by_range", "final_errors"
QUEUED = 4
"""Batches handed out ahead, for each worker."""

Progress = Callable[[int], None]


def campaign(
    model: Any,
    runs: int,
    seed: int = 0,
    *,
    dispersions: Scenario | str | os.PathLike[str] | None = None,
    method: str = "fix",
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Any:
    """Fly many approaches, each with random numbers of its own, and filter and score each.

    The figures depend on model, dispersions, seed and runs alone: not on workers, batches, or how often the campaign
    was stopped and taken up again.

    Parameters
    ----------
    model : Model or str
        A three-beacon mission, or what `load_model` takes.
    runs : int
        Number of approaches.
    seed : int
        Run k of a seed is the same in every campaign: `simulate(model, scenario, seed, run=k)` gives its log.
    dispersions : Scenario or path, optional
        What is flown and what is uncertain; `load_scenario`.
    method : {"fix", "spots"}
        Of the filter, as for `Navigator`.
    out : path, optional
        Folder for parts, summary and pictures; if it holds part of this campaign, the rest is flown. Without it the
        runs are kept in memory.
    workers : int, optional
        Threads here, or processes of a local cluster; the processors at hand if left out.
    cluster : str, optional
        Address of a dask scheduler, or "local" for one of this machine alone (extra `cluster`); needs `out`.
    progress : callable, optional
        Called with the number of runs just done.

    Returns
    -------
    pyarrow.Table
        A row a run: `run`, `status` (RunStatus), `reason`, and the figures; `to_pandas()` makes a data frame.

    Raises
    ------
    ValueError
        For wrong use, and for a folder that holds another campaign.
    """
    mission = load_model(model) if isinstance(model, str | os.PathLike) else model
    scenario = dispersions if isinstance(dispersions, Scenario) else load_scenario(dispersions)
    plan = Plan(mission, scenario, method, seed, runs)
    if workers is not None:
        whole("workers", workers, 1)
    if out is None:
        if cluster is not None:
            raise ValueError("a campaign on a cluster needs a folder that all its workers see: out=...")
        return _in_memory(plan, workers, progress)
    folder = path_of(out, "a campaign's folder")
    fly_missing(plan, folder, workers, cluster, progress)
    finish(plan, folder)
    return Runs(folder, plan).table()


def fly_missing(plan: Plan, folder: Path, workers: int | None, cluster: str | None, progress: Progress | None) -> None:
    """Fly the batches that a campaign's folder has not got yet.

    Raises
    ------
    UsageError
        If the folder holds another campaign, or a package is missing.
    """
    open_folder(folder, plan)
    starts = missing(folder, plan)
    if not starts:
        return
    if cluster is not None:
        from relnav.files.cluster import fly_on_cluster

        fly_on_cluster(plan, folder, starts, cluster, workers or processors(), progress)
        return
    for done in _on_threads(lambda start: write_batch(plan, str(folder), plan.runs_of(start)), starts, workers):
        if progress is not None:
            progress(done)


def finish(plan: Plan, folder: Path, *, pictures: str | None = "png") -> CampaignSummary:
    """Sum a finished campaign up, from its parts: summary, runs that failed, pictures. It can be done again.

    `pictures`: png, pdf or svg; None draws nothing.
    """
    runs = Runs(folder, plan)
    write_failed(folder, runs.failed())
    summary = summarise(plan.runs, runs.status(), plan.scenario.range_edges_m, runs.read, load_published(plan.model))
    write_json(
        {"model": plan.model.name, "method": plan.method, "seed": plan.seed} | summary.to_dict(), folder / SUMMARY
    )
    if pictures is not None:
        from relnav.files.campaign_pictures import draw_errors, draw_final

        draw_errors(summary, runs.read, folder / f"{ERRORS_PICTURE}.{pictures}")
        draw_final(runs.read, folder / f"{FINAL_PICTURE}.{pictures}")
    return summary


def processors() -> int:
    """Processors that this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _in_memory(plan: Plan, workers: int | None, progress: Progress | None) -> Any:
    pyarrow = require_pyarrow()
    tables: dict[int, Any] = {}

    def fly(start: int) -> int:
        tables[start] = table_of(plan, fly_batch(plan, plan.runs_of(start)))
        return len(plan.runs_of(start))

    for done in _on_threads(fly, plan.starts, workers):
        if progress is not None:
            progress(done)
    return pyarrow.concat_tables([tables[start] for start in plan.starts])


def _on_threads(fly: Callable[[int], int], starts: Iterable[int], workers: int | None) -> Iterator[int]:
    """Numbers of runs of the batches that start with these, as they are flown; compiled loops let other threads run."""
    count = workers or processors()
    left, running = iter(starts), set[Future[int]]()
    with ThreadPoolExecutor(count) as pool:
        try:
            while True:
                while len(running) < QUEUED * count and (start := next(left, None)) is not None:
                    running.add(pool.submit(fly, start))
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
