"""Which errors that last a covariance includes, and which that the model states it does not, in words for a reader."""

from relnav.mission import Model, VisionMission
from relnav.navigation.blocks import inertia_errors

MARKERS = "focal length, mounting, markers"
ATTITUDE = "attitude"
INERTIA = "inertia of the target"


def lasting_words(model: Model, method: str) -> dict[str, str]:
    """Of a beacon filter: {"considered": words, "left out": words}, each only where there is something to say."""
    attitude = ATTITUDE if method == "spots" and model.attitude.sigma_rad > 0.0 else ""
    words = ", ".join(part for part in (attitude, model.considered) if part)
    said = {"considered": words, "left out": left_out(model)}
    return {key: value for key, value in said.items() if value}


def in_every_image(considered: str) -> bool:
    """Whether errors that last show in successive innovations: all do but the attitude's, which moves the estimate."""
    return considered not in ("", ATTITUDE)


def marker_words(mission: VisionMission) -> dict[str, str]:
    """The same of a marker filter: which lasting errors are in its innovations, or work in the motion.

    The chaser's attitude is not among them: its error turns target and chaser alike, and no image shows it.
    """
    told = mission.tolerances is not None and mission.tolerances.considered
    words = [MARKERS] * told + [INERTIA] * (inertia_errors(mission) > 0)
    return {"considered": ", ".join(words)} if words else {}


def left_out(mission: Model | VisionMission) -> str:
    """Tolerances that a model states and that its filter is told not to consider; empty if there are none."""
    if mission.tolerances is None or mission.tolerances.considered:
        return ""
    return "focal length, mountings, beacons" if isinstance(mission, Model) else MARKERS


def left_out_line(words: str) -> str:
    """The line of a summary."""
    return f"not in the covariance: {words} (the model's [tolerances]; considered = true there includes them)"
