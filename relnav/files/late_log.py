"""A beacon log with the exposures of its images, `image_t_s`, from a file into a track."""

from relnav.errors import LogError
from relnav.files.log_columns import IMAGE_TIME, log_metadata
from relnav.files.logs import LogFile, check_beacons, read_log
from relnav.mission import Model
from relnav.navigation.late_log import filter_late_images
from relnav.navigation.record import Solution


def says_exposures(log: LogFile) -> bool:
    """Whether the log says when its images were exposed."""
    return log.columns.has(IMAGE_TIME)


def filter_late_log(log: LogFile, model: Model, *, method: str, projection: str | None, smooth: bool) -> Solution:
    """Filter it, in memory: images change what came before them.

    Raises
    ------
    LogError
        If the log cannot be read, or the model takes no late images.
    """
    check_beacons(log.path, log.columns.beacons, model.name, len(model.beacons_lvlh_m))
    if not model.filter.longest_delay_s > 0.0:
        name = log.columns.names[log.columns.index[IMAGE_TIME[0]]]
        raise LogError(
            f"{log.path}: column '{name}' says when images were exposed, and model {model.name} takes no late ones: "
            "give its [filter] a longest_delay_s, or leave the column out"
        )
    read = read_log(log)
    assert read.image_t_s is not None
    solution = filter_late_images(
        model,
        read.t_s,
        read.spots_m,
        read.image_t_s,
        acceleration_m_s2=read.acceleration_m_s2,
        delta_v_m_s=read.delta_v_m_s,
        q_cam_from_lvlh=read.q_cam_from_lvlh,
        spot_sigma_m=read.spot_sigma_m,
        method=method,
        projection=projection,
        smooth=smooth,
    )
    solution.metadata.update(log_metadata(log.path, log.metadata, log.columns.ignored))
    return solution
