"""Why a frame of stars has no attitude, in a sentence."""

from relnav.arrays import Vector
from relnav.sensors.dual_field.focal_length import OFF_FOCAL
from relnav.sensors.dual_field.frame_solver import LEAST_SPOTS, MISFIT, NOISIER, OFF_FOLD, TOO_FEW
from relnav.sensors.dual_field.identify import OFF_FOLD_REASON, ONE_FIELD_REASON
from relnav.sensors.dual_field.search import AMBIGUOUS, ONE_FIELD
from relnav.sensors.dual_field.sensor import StarCamera
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution, which_way

BY_FOCAL_LENGTH = (MISFIT, NOISIER, OFF_FOLD, ONE_FIELD, AMBIGUOUS, OFF_FOCAL)
"""Verdicts on frames in which stars were found: a wrong focal length may have led to each."""

SURELY = 5.0
"""Sigmas by which a focal length is off, for it to be named: two in a million frames show as much by chance."""

FOR_THE_REASON = 0.1
"""Of the attitudes that a frame may take: so many more are tried for another focal length, once stars were found."""

OFF_FOCAL_REASON = "the focal length is farther off than focal_length_relative_sigma states"


def off_focal(focal_px: float, tried: int, spots: int, camera: StarCamera) -> StarSolution:
    """The refusal of a frame that another focal length explains."""
    off = focal_px / camera.focal_length_px - 1.0
    reason = (
        f"the spots fit the stars with a focal length of {focal_px:.6g} px, {100.0 * abs(off):.2g} % "
        f"{'longer' if off > 0.0 else 'shorter'} than the model's: correct focal_length_px, or state how far it may be "
        "off in focal_length_relative_sigma"
    )
    focal = camera.focal_length_px
    return no_solution(StarStatus.NO_MATCH, reason, spots, tried=tried, focal_length_px=focal)


def refused(verdict: int, block: Vector, spots: int, camera: StarCamera, *, told: bool) -> StarSolution:
    """Why there is no attitude; told: whether the spots had covariances of their own."""
    noise, question = "the model's noise", "is the model's spot_noise_px that of the spots"
    if told:
        noise, question = "their covariances say", "are their covariances right"
    tried, here = int(block[19]), which_way(camera.distortion)
    if verdict == TOO_FEW:
        status, reason = StarStatus.TOO_FEW, f"{int(block[20])} spots; {LEAST_SPOTS} or more are needed"
    elif verdict == MISFIT:
        status, reason = (
            StarStatus.NO_MATCH,
            f"stars are found, but the spots lie {block[20]:.1f} times as far from them as {noise}: are "
            f"focal length, distortion{here} and mirror those of this camera, and is the velocity right?",
        )
    elif verdict == NOISIER:
        status, reason = (
            StarStatus.NO_MATCH,
            f"stars are found, but more spots lie beside a star than on one: {question}, and "
            f"are focal length and distortion{here} those of this camera?",
        )
    elif verdict == OFF_FOLD:
        status, reason = StarStatus.NO_MATCH, OFF_FOLD_REASON
    elif verdict == ONE_FIELD:
        status, reason = StarStatus.AMBIGUOUS, ONE_FIELD_REASON
    elif verdict == AMBIGUOUS:
        status, reason = StarStatus.AMBIGUOUS, "two attitudes explain the spots equally well"
    elif verdict == OFF_FOCAL:
        status, reason = StarStatus.NO_MATCH, OFF_FOCAL_REASON
    else:
        status, reason = StarStatus.NO_MATCH, f"none of {tried} attitudes explains the spots"
        reason += f"; is the model's focal length{' or distortion' if here else ''}{here} that of this camera?"
    return no_solution(status, reason, spots, tried=tried, focal_length_px=camera.focal_length_px)
