"""What a sun sensor saw, a picture or a log of spots, measured with its model."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Vector
from relnav.errors import InputError, ModelError, UsageError
from relnav.files.images import is_picture, read_picture
from relnav.files.models import load_model
from relnav.files.sun_logs import read_sun_log
from relnav.sensors import aps_sun, birefringent_sun
from relnav.sensors.aps_sun import ApsSunModel, Calibration
from relnav.sensors.birefringent_sun import BirefringentSunModel
from relnav.sensors.sun_direction import SunDirection

SunModel = ApsSunModel | BirefringentSunModel


def load_sun_sensor(name: str) -> SunModel:
    """A model that describes a sun sensor.

    Raises
    ------
    ModelError
        For a model of another kind.
    """
    model = load_model(name)
    if not isinstance(model, SunModel):
        raise ModelError(f"{model.path}: a sun sensor is expected (sensor_type aps_sun or birefringent_sun)")
    return model


def measure_sun(
    path: Path,
    model: SunModel,
    *,
    calibration: Calibration | None = None,
    corner_px: tuple[float, float] | None = None,
    first_pixel_px: str | None = None,
) -> tuple[list[SunDirection], Vector | None]:
    """Directions of a picture (one) or of a log of spots (one a row), and the log's times.

    Parameters
    ----------
    corner_px : (2,), optional
        Detector coordinates of a picture's first pixel, for a window of the detector.
    first_pixel_px : {"0", "0.5"}, optional
        Coordinate of the first pixel's centre in a log.

    Raises
    ------
    UsageError
        For an option that does not go with the file or the model.
    InputError
        For a file that cannot be read, or counts that the model's read-out cannot give.
    """
    if calibration is not None and not isinstance(model, ApsSunModel):
        raise UsageError("--calibration is for the APS sensor; a birefringent sensor's constants stand in its model")
    if not is_picture(path):
        if corner_px is not None:
            raise UsageError("--corner-px is for a picture; spots of a log are in pixels of the whole detector")
        log = read_sun_log(path, 1 if isinstance(model, ApsSunModel) else 2, float(first_pixel_px or 0.0))
        return [_direction(spots.squeeze(), model, calibration, (0.0, 0.0)) for spots in log.spots_px], log.t_s
    if first_pixel_px is not None:
        raise UsageError("--first-pixel-px is for a log of spots; a picture has its own pixels")
    picture = read_picture(path)
    counts = np.asarray(picture.counts, dtype=np.float64)
    if not np.isfinite(counts).all():
        raise InputError(f"{path}: {int(np.sum(~np.isfinite(counts)))} pixels are no finite number")
    if counts.max() > model.image.full_scale:
        raise InputError(
            f"{path}: counts up to {counts.max():g}, but {model.name} reads up to {model.image.full_scale}; "
            "set bits and full_scale_e in [image] of the model to those of this detector"
        )
    return [_direction(counts, model, calibration, corner_px or (0.0, 0.0))], None


def _direction(
    seen: ArrayLike, model: SunModel, calibration: Calibration | None, corner_px: tuple[float, float]
) -> SunDirection:
    if isinstance(model, ApsSunModel):
        return aps_sun.measure(seen, model, calibration=calibration, corner_px=corner_px)
    return birefringent_sun.measure(seen, model, corner_px=corner_px)
