"""Which kind of run a model flies."""

from typing import Any

from relnav.accuracy.run_figures import RunKind
from relnav.mission import Model, VisionMission
from relnav.spacecraft import Vehicle


def kind_of(model: Any) -> RunKind:
    """How a loaded model is flown and scored.

    Raises
    ------
    ValueError
        For what does not fly.
    """
    if isinstance(model, Model):
        from relnav.accuracy.run_score import BEACONS

        return BEACONS
    if isinstance(model, VisionMission):
        from relnav.accuracy.run_score_markers import MARKERS

        return MARKERS
    if isinstance(model, Vehicle):
        from relnav.accuracy.run_score_vehicle import VEHICLES

        return VEHICLES
    kind = type(model).__name__
    raise ValueError(
        f"a campaign flies a three_beacon or three_marker mission, or a vehicle, relnav.load_model(...); got a {kind}"
    )
