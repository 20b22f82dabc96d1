"""The accuracy benchmark of a sensor system with the claims that stand beside its model."""

from collections.abc import Callable
from typing import Any

from relnav.arrays import whole
from relnav.files.models import load_model, load_published
from relnav.files.systems import resolve, system_of


def measure_accuracy(
    model: Any, *, runs: int | None = None, seed: int = 7, progress: Callable[[int], None] | None = None
) -> Any:
    """Measure a sensor system against truth and against its paper.

    For the three-beacon sensor: single images, filters and smoothers of a mission.

    Parameters
    ----------
    model : Model or str
        A loaded model, or what `load_model` takes; its `published.toml` holds the claims.
    runs : int, optional
        Simulated runs (three-beacon: approaches of each of three campaigns); the system's own default if left out.
    seed : int
        Random seed: the same seed, the same report.
    progress : callable, optional
        Called with the number of runs just done.

    Returns
    -------
    AccuracyReport or ClaimsReport
        `ok` is True if every row came out as `published.toml` expects.

    Raises
    ------
    ValueError
        For fewer than two runs, or something that is not a model.
    """
    mission = load_model(model) if isinstance(model, str) else model
    system = system_of(mission)
    count, seed = whole("runs", system.runs if runs is None else runs, 2), whole("seed", seed)
    measure = resolve(system.accuracy)
    return measure(mission, load_published(mission), runs=count, seed=seed, progress=progress)
