"""Campaigns: many approaches of a scenario, flown, filtered and summed up; on threads here, or on a cluster."""

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from relnav.accuracy.campaign_plan import Batch, Plan, fly_batch
from relnav.accuracy.campaign_summary import CampaignSummary, summarise
from relnav.accuracy.run_kinds import kind_of
from relnav.arrays import whole
from relnav.files.campaign_folder import (
    Runs,
    missing,
    open_folder,
    pyarrow_for_campaigns,
    table_of,
    write_batch,
    write_failed,
)
from relnav.files.models import load_model, load_published
from relnav.files.paths import path_of
from relnav.files.scenarios import load_scenario
from relnav.files.tables import write_json
from relnav.files.workers import in_processes, on_threads, processors
from relnav.simulation.dispersions import Scenario
from relnav.simulation.vehicle_dispersions import VehicleScenario

SUMMARY, ERRORS_PICTURE, FINAL_PICTURE = "summary.json", "errors_by_range", "final_errors"
DIED = (
    "a process of the campaign died; call it again to go on, with --cluster local if it dies again: that names the "
    'run. A program needs if __name__ == "__main__": around its call, or workers=1'
)

Progress = Callable[[int], None]
T = TypeVar("T")


def campaign(
    model: Any,
    runs: int,
    seed: int = 0,
    *,
    dispersions: Scenario | VehicleScenario | str | os.PathLike[str] | None = None,
    method: str | None = None,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Any:
    """Fly many approaches, each with random numbers of its own, and filter and score each.

    The figures depend on model, dispersions, seed and runs alone: not on workers, batches, or how often the campaign
    was interrupted.

    Parameters
    ----------
    model : Model, VisionMission, Vehicle or str
        A three-beacon or three-marker mission or a vehicle, or what `load_model` takes.
    runs : int
        Number of approaches.
    seed : int
        Run k of a seed is the same in every campaign: `simulate(model, scenario, seed, run=k)` gives its log.
    dispersions : Scenario, VehicleScenario or path, optional
        What is flown and what is uncertain; `load_scenario`.
    method : {"fix", "spots"}, optional
        Of a beacon filter, as for `Navigator`; others have one.
    out : path, optional
        Folder for parts, summary and pictures; if it holds part of this campaign, the rest is flown. Without it the
        runs are kept in memory.
    workers : int, optional
        Threads here, or processes of a local cluster; the processors at hand if left out. Markers and vehicles are
        flown by processes, for which a program needs `if __name__ == "__main__":`; 1 flies them in this one.
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
    plan = plan_of(mission, dispersions, method, seed, runs)
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


def plan_of(model: Any, dispersions: Any, method: str | None, seed: int, runs: int) -> Plan:
    """The campaign of a loaded model; a scenario, its path, or None for the default, and so of the method."""
    paths = dispersions is None or isinstance(dispersions, str | os.PathLike)
    scenario = load_scenario(dispersions, model=model) if paths else dispersions
    return Plan(model, scenario, kind_of(model).methods[0] if method is None else method, seed, runs)


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
    for done in _side_by_side(plan, partial(_write, plan, str(folder)), starts, workers):
        if progress is not None:
            progress(done)


def finish(plan: Plan, folder: Path, *, pictures: str | None = "png") -> CampaignSummary:
    """Sum a finished campaign up, from its parts: summary, runs that failed, pictures. It can be done again.

    `pictures`: png, pdf or svg; None draws nothing.
    """
    runs = Runs(folder, plan)
    write_failed(folder, runs.failed())
    edges, figures = plan.scenario.range_edges_m, plan.kind.figures
    summary = summarise(plan.runs, runs.status(), edges, runs.read, load_published(plan.model), figures)
    summary = replace(summary, note=plan.note)
    write_json(
        {"model": plan.model.name, "method": plan.method, "seed": plan.seed} | summary.to_dict(), folder / SUMMARY
    )
    if pictures is not None:
        from relnav.files.campaign_pictures import draw_errors, draw_final

        draw_errors(summary, runs.read, folder / f"{ERRORS_PICTURE}.{pictures}")
        draw_final(summary, runs.read, folder / f"{FINAL_PICTURE}.{pictures}")
    return summary


def _in_memory(plan: Plan, workers: int | None, progress: Progress | None) -> Any:
    pyarrow = pyarrow_for_campaigns()
    batches: dict[int, Batch] = {}
    for batch in _side_by_side(plan, partial(_fly, plan), plan.starts, workers):
        batches[int(batch.run[0])] = batch
        if progress is not None:
            progress(len(batch.run))
    return pyarrow.concat_tables([table_of(plan, batches[start]) for start in plan.starts])


def _fly(plan: Plan, start: int) -> Batch:
    return fly_batch(plan, plan.runs_of(start))


def _write(plan: Plan, folder: str, start: int) -> int:
    return write_batch(plan, folder, plan.runs_of(start))


def _side_by_side(plan: Plan, fly: Callable[[int], T], starts: Iterable[int], workers: int | None) -> Iterator[T]:
    """What becomes of the batches that start with these, as they are flown: on threads, or in processes.

    Raises
    ------
    InputError
        If a process dies.
    """
    count = workers or processors()
    if plan.kind.threads:
        return on_threads(fly, starts, count)
    return in_processes(fly, starts, count, plan, DIED)
