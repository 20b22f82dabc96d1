"""The accuracy benchmark of a mission with the claims that stand beside its model."""

from collections.abc import Callable

from relnav.accuracy.report import AccuracyReport, measure
from relnav.files.models import load_model, load_published
from relnav.mission import Model


def measure_accuracy(
    model: Model | str, *, runs: int = 200, seed: int = 7, progress: Callable[[int], None] | None = None
) -> AccuracyReport:
    """Measure single shots, filters and smoothers of a mission against truth and against its paper.

    Parameters
    ----------
    model : Model or str
        A loaded model, or what `load_model` takes; its `published.toml` holds the claims.
    runs : int
        Simulated approaches of each of three campaigns.
    seed : int
        Of everything random: the same seed, the same report.
    progress : callable, optional
        Called with the number of runs just done, out of 3 * runs.

    Returns
    -------
    AccuracyReport
        `ok` is True if every row came out as `published.toml` expects.

    Raises
    ------
    ValueError
        For fewer than two runs.
    """
    mission = load_model(model) if isinstance(model, str) else model
    return measure(mission, load_published(mission), runs=runs, seed=seed, progress=progress)
