"""What the detector of a true trajectory shows: projected spots, noise, and the faults a real one has."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack
from relnav.mission import Model


@dataclass(frozen=True)
class Faults:
    """How often things go wrong, per spot and epoch.

    Attributes
    ----------
    dropout : float
        Probability that a spot is not seen.
    outliers : float
        Probability that a spot is somewhere else on the detector (glint): uniform over it.
    """

    dropout: float = 0.0
    outliers: float = 0.0

    def __post_init__(self) -> None:
        for name in ("dropout", "outliers"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ValueError(f"{name} is a probability, 0 <= {name} < 1; got {getattr(self, name)!r}")


def project_beacons(model: Model, state: Matrix) -> Stack:
    """Noise-free spots (n, 3, 2) m of true states (n, 6), camera attitude held; NaN where a beacon is behind."""
    dcm = model.dcm_cam_from_lvlh
    camera = state[:, None, :3] + dcm.T @ model.camera_lever_cam_m
    c = (model.beacons_lvlh_m[None] - camera) @ dcm.T
    with np.errstate(divide="ignore", invalid="ignore"):
        image = model.sensor.focal_length_m * c[..., :2] / c[..., 2:]
    spots: Stack = np.where(c[..., 2:] > 0.0, image, np.nan)
    return spots


def image(model: Model, state: Matrix, faults: Faults, rng: np.random.Generator) -> Stack:
    """Spots (n, 3, 2) m that a log of the true states (n, 6) holds; NaN = not seen."""
    spots = project_beacons(model, state)
    spots = spots + rng.normal(size=spots.shape) * model.sensor.spot_noise_m
    half = 0.5 * np.array(model.sensor.detector_size_m)
    elsewhere = rng.uniform(-1.0, 1.0, size=spots.shape) * half
    glint = rng.uniform(size=spots.shape[:2]) < faults.outliers
    spots = np.where(glint[..., None], elsewhere, spots)
    unseen = (rng.uniform(size=spots.shape[:2]) < faults.dropout) | ~(np.abs(spots) <= half).all(axis=-1)
    spots[unseen] = np.nan
    return spots
