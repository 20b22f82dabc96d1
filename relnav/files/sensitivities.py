"""Sensitivities of the error at the port to what is uncertain: flown as a campaign is, with a table and a picture."""

import dataclasses
import os
from pathlib import Path
from typing import Any

from relnav.accuracy.campaign_plan import Plan
from relnav.accuracy.sensitivities import Sensitivities, base_runs, sum_up
from relnav.accuracy.sensitivity_design import Design
from relnav.files.campaign import Progress, fly_missing, plan_of
from relnav.files.campaign_folder import Runs, write_failed
from relnav.files.models import load_model
from relnav.files.paths import path_of
from relnav.files.tables import write_json

TABLE, PICTURE = "sensitivities.json", "sensitivities"


def sensitivities(
    model: Any,
    runs: int,
    seed: int = 0,
    *,
    out: str | os.PathLike[str],
    dispersions: Any = None,
    method: str | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    progress: Progress | None = None,
) -> Sensitivities:
    """Fly a study of what the error at the port comes from: one number at a time, and Sobol' indices.

    It flies runs times (2 + causes) approaches and a few for each number, and goes on where it was stopped, as a
    campaign does.

    Parameters
    ----------
    model, seed, dispersions, method, workers, cluster, progress
        As for `campaign`.
    runs : int
        Base runs, a power of two; 256 give indices within some 0.1.
    out : path
        Folder for parts, table and picture.

    Returns
    -------
    Sensitivities
        First-order and total indices of every component of the error at the end, with intervals; `lines()` is a table.

    Raises
    ------
    ValueError
        For wrong use, and for a folder that holds another campaign.
    """
    mission = load_model(model) if isinstance(model, str | os.PathLike) else model
    plan = study_of(plan_of(mission, dispersions, method, seed, base_runs(runs)))
    folder = path_of(out, "a folder")
    fly_missing(plan, folder, workers, cluster, progress)
    return finish_study(plan, folder)


def study_of(plan: Plan) -> Plan:
    """The study whose base runs are those of a campaign."""
    design = Design(plan.kind.drawn(plan.model, plan.scenario), plan.seed, base_runs(plan.runs))
    return dataclasses.replace(plan, runs=design.runs, design=plan.runs)


def finish_study(plan: Plan, folder: Path, *, pictures: str | None = "png") -> Sensitivities:
    """Sum a study that was flown up: table and picture. It can be done again; `pictures` as in `campaign.finish`."""
    design = Design(plan.kind.drawn(plan.model, plan.scenario), plan.seed, plan.design)
    runs = Runs(folder, plan)
    write_failed(folder, runs.failed())
    found = sum_up(design, plan.kind.figures.state, runs.read, plan.seed)
    write_json({"model": plan.model.name, "method": plan.method, "seed": plan.seed} | found.to_dict(), folder / TABLE)
    if pictures is not None:
        from relnav.files.campaign_pictures import draw_sensitivities

        draw_sensitivities(found, folder / f"{PICTURE}.{pictures}")
    return found
