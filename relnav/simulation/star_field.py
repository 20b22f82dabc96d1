"""Frames of star spots made from the catalogue: one field or two superimposed, with noise, gaps and false spots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Matrix, Vector
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.geometry.rotation_vector import turned
from relnav.geometry.star_places import LIGHT_KM_S, aberration
from relnav.sensors.dual_field.optics import project
from relnav.sensors.dual_field.sensor import StarSensor


@dataclass(frozen=True)
class SkyConditions:
    """What a simulated frame shows.

    Attributes
    ----------
    faintest_mag : float
        Hipparcos magnitude of the faintest star seen in field 0; in field 1 by `Fold.fainter_mag` brighter.
    magnitude_noise, missing, false_spots : float, float, int
        1-sigma of a spot's magnitude, probability that a star has no spot, and spots that are no stars.
    field_radius_rad : float
        Of the round field.
    """

    faintest_mag: float = 5.75
    magnitude_noise: float = 0.15
    missing: float = 0.05
    false_spots: int = 3
    field_radius_rad: float = np.radians(7.0)


@dataclass(frozen=True)
class SimulatedStars:
    """One frame and its truth; spots brightest first.

    Attributes
    ----------
    spots_px, magnitude : (n, 2), (n,)
        What the sensor reads.
    hip, field : (n,)
        Which star each spot is (0: none), and the field that it came from (-1: none).
    dcm_cam_from_icrs : (3, 3)
        True attitude.
    velocity_km_s : (3,)
        Observer's barycentric velocity.
    """

    spots_px: Matrix
    magnitude: Vector
    hip: NDArray[np.int32]
    field: Codes
    dcm_cam_from_icrs: Matrix
    velocity_km_s: Vector


class StarFieldSimulator:
    """Makes frames of a star sensor at its epoch.

    Parameters
    ----------
    sensor : StarSensor
        Camera, fold and catalogue.
    conditions : SkyConditions
        What is seen.
    fold : (3, 3), optional
        The real fold, where it is not the one that the sensor believes in.
    """

    def __init__(self, sensor: StarSensor, conditions: SkyConditions, fold: Matrix | None = None) -> None:
        self.sensor, self.conditions = sensor, conditions
        self.fold = sensor.fold.matrix if fold is None else fold
        catalogue = sensor.catalogue
        deepest = conditions.faintest_mag + max(0.0, -sensor.fold.fainter_mag)
        part = slice(0, int(np.searchsorted(catalogue.hp_mag, deepest, side="right")))
        self.directions = catalogue.directions(sensor.identification.epoch_jyear, stars=part)
        self.magnitude, self.hip = np.asarray(catalogue.hp_mag[part], dtype=np.float64), catalogue.hip[part]

    def mount(self, rng: np.random.Generator) -> None:
        """Draw the real fold anew, with the error that the sensor states."""
        nominal = self.sensor.fold.matrix
        if nominal is not None:
            values, axes = np.linalg.eigh(self.sensor.fold.covariance)
            phi = axes @ (np.sqrt(np.maximum(values, 0.0)) * rng.normal(size=3))
            self.fold = turned(np.eye(3), phi) @ nominal

    def frame(
        self, rng: np.random.Generator, *, velocity_km_s: Vector | None = None, dcm: Matrix | None = None
    ) -> SimulatedStars:
        """A frame with a random attitude (or dcm) as a moving observer sees it (at rest unless a velocity is given)."""
        velocity = np.zeros(3) if velocity_km_s is None else np.asarray(velocity_km_s, dtype=np.float64)
        A = random_attitude(rng) if dcm is None else dcm
        beta, camera, radius = velocity / LIGHT_KM_S, self.sensor.camera, self.conditions.field_radius_rad
        spots, magnitude, hip, field = [], [], [], []
        for f, fold in enumerate([np.eye(3)] if self.fold is None else [np.eye(3), self.fold]):
            turn = fold.T @ A  # s = M u, so that u = M^T s
            reach = np.cos(radius + 2.0 * np.linalg.norm(beta))  # aberration moves no star farther
            present = rng.random(len(self.directions)) >= self.conditions.missing
            near = np.flatnonzero((self.directions @ turn[2] > reach) & present)
            rays = aberration(self.directions[near], beta) @ turn.T
            fainter = self.sensor.fold.fainter_mag if f else 0.0
            seen = self.magnitude[near] + fainter <= self.conditions.faintest_mag
            inside = (rays[:, 2] > np.cos(radius)) & seen
            chosen = near[inside]
            spots.append(project(rays[inside], camera.focal_length_px, camera.principal_point_px, camera.distortion))
            magnitude.append(self.magnitude[chosen] + fainter)
            hip.append(self.hip[chosen])
            field.append(np.full(len(chosen), f, dtype=np.int64))
        return self._finished(rng, np.concatenate(spots), np.concatenate(magnitude), hip, field, A, velocity)

    def false_frame(self, rng: np.random.Generator, spots: int) -> tuple[Matrix, Vector]:
        """A frame of false spots alone, brightest first: spots (n, 2) px and magnitudes (n,)."""
        magnitude = np.sort(self._false_magnitudes(rng, spots))
        return self._false_spots(rng, spots), magnitude

    def _false_magnitudes(self, rng: np.random.Generator, count: int) -> Vector:
        return self.magnitude[rng.integers(0, len(self.magnitude), count)]

    def _false_spots(self, rng: np.random.Generator, count: int) -> Matrix:
        radius = self.sensor.camera.focal_length_px * np.tan(self.conditions.field_radius_rad)
        r, angle = radius * np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
        return np.column_stack([r * np.cos(angle), r * np.sin(angle)])

    def _finished(
        self,
        rng: np.random.Generator,
        spots: Matrix,
        magnitude: Vector,
        hip: list[NDArray[np.int32]],
        field: list[Codes],
        dcm: Matrix,
        velocity: Vector,
    ) -> SimulatedStars:
        """Noise, false spots, and the order of brightness."""
        false = self.conditions.false_spots
        spots = spots + rng.normal(size=spots.shape) * self.sensor.camera.spot_noise_px
        spots = np.concatenate([spots, self._false_spots(rng, false)])
        magnitude = magnitude + rng.normal(size=len(magnitude)) * self.conditions.magnitude_noise
        magnitude = np.concatenate([magnitude, self._false_magnitudes(rng, false)])
        order = np.argsort(magnitude)
        return SimulatedStars(
            spots[order],
            magnitude[order],
            np.concatenate([*hip, np.zeros(false, dtype=np.int32)])[order],
            np.concatenate([*field, np.full(false, -1, dtype=np.int64)])[order],
            dcm,
            velocity,
        )


def random_attitude(rng: np.random.Generator) -> Matrix:
    """A rotation drawn evenly over all of them."""
    q = rng.normal(size=4)
    return dcm_from_quaternion(q / np.linalg.norm(q))


def random_velocity(rng: np.random.Generator, speed_km_s: float = 30.3) -> Vector:
    """A velocity of given size in a random direction, (3,) km/s."""
    v = rng.normal(size=3)
    velocity: Vector = speed_km_s * v / np.linalg.norm(v)
    return velocity
