"""The filters a second time, on filterpy (`engine="filterpy"`): a second opinion, loaded when it is asked for."""

from typing import TYPE_CHECKING

from relnav.arrays import Vector
from relnav.mission import Model, VisionMission

if TYPE_CHECKING:
    from relnav.navigation.reference.beacon_filter import ReferenceEngine
    from relnav.navigation.reference.marker_filter import ReferencePose


def for_beacons(
    engine: str, model: Model, method: str, projection: str | None, block: Vector
) -> "ReferenceEngine | None":
    """The second beacon filter, which writes what comes out into the memory `block`; None for relnav's own."""
    if engine != "filterpy":
        return None
    from relnav.navigation.reference.beacon_filter import ReferenceEngine

    return ReferenceEngine(model, method, projection, block)


def for_markers(engine: str, mission: VisionMission) -> "ReferencePose | None":
    """The second marker filter; None for relnav's own."""
    if engine != "filterpy":
        return None
    from relnav.navigation.reference.marker_filter import ReferencePose

    return ReferencePose(mission)
