"""What an image of beacons says to `engine="filterpy"`: written from the model, derivatives by complex steps.

`spots`: beacon i, at b_i from the target's centre of mass, is seen at f (c_x, c_y) / c_z of c = D (b_i - x) - lever,
D camera from lvlh. `fix`, and `spots` without an attitude: of the rays u from the camera to A, B and C the numbers
g1 = |u_A - u_B|^2, g2 = u_C . (u_A - u_B), g3 = u_C . (u_A x u_B), which do not depend on the attitude; a fix is the
place p, docking frame, at which they are those measured, and dp = (dg/dp)^-1 dg of all that moves them.

Sixteen errors are counted for each beacon: a turn of the chaser about camera axes (3), the relative one of the focal
length, a turn of the camera (3), of the beacons about the port (3; docking axes), of its place (3; docking axes), and
of the state's position (3).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from relnav.arrays import Codes, Flags, Matrix, Stack, Vector
from relnav.mission import Model
from relnav.navigation.blocks import ATTITUDE_ERRORS, FIELD_ERRORS, TOLERANCES_SHARED, considered_errors
from relnav.navigation.observation.beacon_geometry import COS_MISALIGNED, MOST_SIGMAS2, TIGHT_SHARE2
from relnav.navigation.reference.motion import IMAGINARY, cross
from relnav.navigation.reference.numbers import ALL, angles_between, cosine, numbers_of, to_angles, turn_of, unit
from relnav.sensors.measurement import (
    BEHIND,
    DEGENERATE,
    MISALIGNED,
    NO_CONVERGENCE,
    NOT_SEEN,
    OFF_DETECTOR,
    OK,
    OUTSIDE_DOMAIN,
    SWAPPED,
)
from relnav.sensors.three_beacon.fix import PERSPECTIVE, WORK_ROWS, solve_fix
from relnav.sensors.three_beacon.measure import PROJECTIONS
from relnav.sensors.three_beacon.parallel import solve_parallel_jacobian
from relnav.sensors.three_beacon.perspective import inside_domain

TURN, FOCAL, CAMERA, BEACONS, PLACE, POSITION = (
    slice(0, 3), 3, slice(4, 7), slice(7, 10), slice(10, 13), slice(13, 16),
)  # fmt: skip
ERRORS = 16


@dataclass(frozen=True)
class BeaconImage:
    """What is used of an image, k rows.

    Attributes
    ----------
    seen, reason : int
        Groups that there are: beacons, or the image as one; Status code.
    groups, places : (k,)
        Beacon of each row (0 of numbers); which of the innovations it is.
    rows, residual, noise : (k, 6), (k,), (k, k)
    turns : (k, 3)
        Coordinates by turns of the chaser.
    by_spots : (k, 6)
        Numbers by the spots of A, B and C.
    value : (3,) or (k,)
        What was measured: the place of a fix, or numbers.
    """

    seen: int
    reason: int
    groups: Codes
    places: Codes
    rows: Matrix
    residual: Vector
    noise: Matrix
    turns: Matrix
    by_spots: Matrix
    value: Vector


def _seen_by(by_spots: Matrix) -> list[int]:
    """The beacons that numbers rest on, by their derivative (k, 6)."""
    return [i for i in ALL if np.any(by_spots[:, 2 * i : 2 * i + 2])]


def _nothing(seen: int, reason: int) -> BeaconImage:
    none, empty = np.zeros(0, dtype=np.int64), np.zeros((0, 6))
    return BeaconImage(
        seen, reason, none, none, empty, np.zeros(0), np.zeros((0, 0)), np.zeros((0, 3)), empty, np.zeros(0)
    )


@dataclass(frozen=True)
class Prior:
    """Where the camera is predicted to be, docking frame, and the variance of that, m^2."""

    place: Vector
    variance: float

    @property
    def tight(self) -> bool:
        """Whether the predicted geometry can stand for the true one: position sigma below 2 % of the range."""
        return bool(self.variance < TIGHT_SHARE2 * (self.place @ self.place))


class BeaconOptics:
    """Sensor and beacons of a model, and what a caller has told of them."""

    def __init__(self, model: Model, method: str, projection: str | None) -> None:
        """Take the model."""
        sensor, tolerances, calibration = model.sensor, model.tolerances, model.calibration
        self.method, count = method, len(model.beacons_lvlh_m)
        self.exact = PROJECTIONS[sensor.projection if projection is None else projection] == PERSPECTIVE
        self.beacons, self.dock, self.port = model.beacons_lvlh_m, model.dcm_dock_from_lvlh, model.port_position_m
        self.three, self.lever = sensor.beacons_dock_m[:3], model.camera_lever_cam_m
        self.focal_length, self.half = sensor.focal_length_m, 0.5 * np.array(sensor.detector_size_m)
        self.half_spacing, self.c_distance = sensor.beacon_half_spacing_m, sensor.beacon_c_distance_m
        self.spot_sigma = np.full((count, 2), sensor.spot_noise_m)
        self.lasting = np.full(count, model.lasting_spot_sigma_m)
        self.attitude_sigma, self.attitude_noise = model.attitude.sigma_rad, model.attitude.noise_rad
        self.held, self.held_known = model.dcm_cam_from_lvlh, model.attitude.mode == "lvlh_hold"
        self.dcm, self.known = self.held, self.held_known
        self.built = tolerances if tolerances is not None and tolerances.considered else None
        self.field = (
            (np.zeros(2), self.half)
            if calibration is None
            else (np.array(calibration.center_m), np.array(calibration.half_width_m))
        )
        self.wanted = slice(*considered_errors(model, method))

    @property
    def considered(self) -> int:
        """How many lasting errors."""
        return self.wanted.stop - self.wanted.start

    @property
    def shared(self) -> slice:
        """Which of them all beacons share: the attitude's, the focal length's, and those of the mountings."""
        first = FIELD_ERRORS - self.wanted.start
        return slice(first, first + ATTITUDE_ERRORS + TOLERANCES_SHARED)

    @property
    def coordinates(self) -> bool:
        """Whether the detector's coordinates themselves are the measurement, a group a beacon."""
        return self.method == "spots" and self.known

    @property
    def offset(self) -> Vector:
        """Camera from the chaser's centre of mass, from the port, `lvlh_ccsds`."""
        offset: Vector = self.dcm.T @ self.lever - self.port
        return offset

    def place(self, x: Vector) -> Vector:
        """The camera of a state, docking frame."""
        place: Vector = self.dock @ (x[:3] + self.offset)
        return place

    @property
    def arm_covariance(self) -> Matrix:
        """What the noise of the attitude does to where the camera is from the centre of mass, `lvlh_ccsds` m^2."""
        swing = self.attitude_noise * cross(np.eye(3), self.dcm.T @ self.lever)
        out: Matrix = swing.T @ swing
        return out

    # --- coordinates

    def coordinate_slopes(self, x: Vector) -> tuple[Matrix, Vector, Stack]:
        """Spots (n, 2) m of a state, their depths (n,), and derivatives (n, 2, 16) by the errors."""
        n = len(self.beacons)
        e = np.broadcast_to(1j * IMAGINARY * np.eye(ERRORS)[:, None], (ERRORS, n, ERRORS))
        arm = self.beacons - self.port
        arm = arm + cross(e[..., BEACONS] @ self.dock, arm) + e[..., PLACE] @ self.dock
        d = (arm + self.port - x[:3] - e[..., POSITION]) @ self.dcm.T
        c = d - cross(e[..., TURN], d) - self.lever
        c = c - cross(e[..., CAMERA], c)
        depth = np.where(c[..., 2:].real > 0.0, c[..., 2:], 1.0)
        spots = self.focal_length * (1.0 + e[..., FOCAL, None]) * c[..., :2] / depth
        return spots[0].real, c[0, :, 2].real, np.moveaxis(spots.imag / IMAGINARY, 0, -1)

    def usable(self, spots: Matrix) -> tuple[Flags, int, int]:
        """Which coordinates (n, 2) can be used, how many beacons are seen, Status code."""
        there: Flags = ~np.isnan(spots)
        off: Flags = np.any(there & ~(np.abs(np.nan_to_num(spots, nan=0.0, posinf=np.inf)) <= self.half), axis=1)
        seen = int(there.any(axis=1).sum())
        reason = NOT_SEEN if seen == 0 else (OFF_DETECTOR if off.any() else OK)
        usable: Flags = there & ~off[:, None]
        return usable, seen, reason

    def see_coordinates(self, x: Vector, spots: Matrix) -> BeaconImage:
        """What of the spots (n, 2) m is used of their coordinates, without what is considered."""
        usable, seen, reason = self.usable(spots)
        expected, depth, slopes = self.coordinate_slopes(x)
        behind = usable.any(axis=1) & ~(depth > 0.0)
        beacon, axis = np.nonzero(usable & ~behind[:, None])
        rows = np.zeros((len(beacon), 6))
        rows[:, :3] = slopes[beacon, axis, POSITION]
        residual = spots[beacon, axis] - expected[beacon, axis]
        turns, none = slopes[beacon, axis, TURN], np.zeros((len(beacon), 6))
        noise = np.diag(self.spot_sigma[beacon, axis] ** 2)
        reason = BEHIND if behind.any() else reason
        return BeaconImage(seen, reason, beacon, 2 * beacon + axis, rows, residual, noise, turns, none, np.zeros(0))

    # --- numbers of the rays

    def rays_of(self, spots: Matrix) -> Matrix:
        """Unit rays (..., 3, 3), camera axes, toward spots (..., 3, 2)."""
        f = np.full((*spots.shape[:-1], 1), self.focal_length)
        return unit(np.concatenate([spots, f], axis=-1))

    def number_slopes(self, p: Vector, pair: list[int]) -> tuple[Vector, Matrix]:
        """Numbers (k,) seen from p, docking frame, and their derivatives (k, 3 x 16) by the errors of A, B and C."""
        e = (1j * IMAGINARY * np.eye(3 * ERRORS)).reshape(-1, 3, ERRORS)
        swung = cross(e[..., TURN], self.lever) @ self.dcm @ self.dock.T
        at = self.three + cross(e[..., BEACONS], self.three) + e[..., PLACE]
        g = numbers_of(unit(at - p - swung - e[..., POSITION]), pair)
        return g[0].real, g.imag.T / IMAGINARY

    def by_place(self, p: Vector, pair: list[int]) -> tuple[Vector, Matrix]:
        """Numbers (k,) seen from p, and their derivative (k, 3) by p."""
        g, slopes = self.number_slopes(p, pair)
        return g, slopes.reshape(len(g), 3, ERRORS)[:, :, POSITION].sum(axis=1)

    def by_spots(self, spots: Matrix, pair: list[int]) -> Matrix:
        """Derivative (k, 6) of the numbers by the spots (3, 2); of a pair zero for the one that is not seen."""
        steps = np.nan_to_num(spots) + 1j * IMAGINARY * np.eye(6).reshape(6, 3, 2)
        out: Matrix = numbers_of(self.rays_of(steps), pair).imag.T / IMAGINARY
        return out

    def _cam_from_dock(self) -> Matrix:
        out: Matrix = self.dcm @ self.dock.T
        return out

    def spread2(self, range2: float) -> float:
        """Twice the variance of the range of one image, over its square."""
        sigma2 = 0.25 * float(np.sum(self.spot_sigma[:2] ** 2))
        return sigma2 * range2 / (self.focal_length * self.half_spacing) ** 2

    def _attitude_of(self, rays: Matrix, p: Vector) -> int:
        """Whether the attitude that a fix implies is the stated one, to 10 deg or five sigmas of a far image."""
        if not self.known:
            return OK
        said = unit(self.three - p) @ self._cam_from_dock().T
        along, across = (cosine(said[0] + sign * said[1], rays[0] + sign * rays[1]) for sign in (-1.0, 1.0))
        limit = min(COS_MISALIGNED, 1.0 - 0.25 * MOST_SIGMAS2 * self.spread2(float(p @ p)))
        if min(along, across) > limit:
            return OK
        return SWAPPED if along < 0.0 else MISALIGNED

    def fix(self, spots: Matrix) -> tuple[int, Vector]:
        """The closed form of A, B and C, and what is wrong with it, as a Status code."""
        p, work = np.zeros(3), np.zeros((WORK_ROWS, 6))
        a, b, kind = self.half_spacing, self.c_distance, PROJECTIONS["perspective" if self.exact else "parallel"]
        three = np.ascontiguousarray(spots[:3])
        status = int(solve_fix(three, self.focal_length, self.half[0], self.half[1], a, b, kind, p, work))
        return (status if status != OK else self._attitude_of(self.rays_of(three), p)), p

    def _fix_near(self, place: Vector, spots: Matrix) -> tuple[int, Vector]:
        """The fix by Newton's method from the predicted place; NO_CONVERGENCE if that does not settle."""
        measured, p = numbers_of(self.rays_of(spots), ALL), place
        last = math.inf
        for _ in range(20):
            g, slope = self.by_place(p, ALL)
            if not abs(np.linalg.det(slope)) > 0.0:
                return NO_CONVERGENCE, p
            step = np.linalg.solve(slope, measured - g)
            p = p + step
            size, scale = float(np.abs(step).sum()), float(np.abs(p).sum())
            if not size < scale:
                return NO_CONVERGENCE, p
            if size < 1e-13 * scale or (size < 1e-8 * scale and size >= 0.5 * last):
                if not inside_domain(p, self.c_distance):
                    return OUTSIDE_DOMAIN, p
                return self._attitude_of(self.rays_of(spots), p), p
            last = size
        return NO_CONVERGENCE, p

    def _see_numbers(self, x: Vector, spots: Matrix, prior: Prior) -> BeaconImage:
        three = spots[:3]
        there = ~np.isnan(three)
        with np.errstate(invalid="ignore"):
            whole = (np.abs(three) <= self.half).all(axis=1)
        seen, tight = int(there.any(axis=1).sum()), prior.tight
        if seen == 0:
            return _nothing(0, NOT_SEEN)
        if self.method == "spots" and seen == 2 and whole.sum() == 2 and tight:
            pair = np.flatnonzero(whole).tolist()
            by_spots = self.by_spots(three, pair)
            return self._with_noise(x, by_spots, numbers_of(self.rays_of(np.nan_to_num(three)), pair))
        status = NOT_SEEN if not there.all() else (OK if whole.all() else OFF_DETECTOR)
        p = prior.place
        if status == OK:
            status, p = self._fix_near(prior.place, three) if self.exact and tight else (NO_CONVERGENCE, p)
            if status in (NO_CONVERGENCE, OUTSIDE_DOMAIN):
                status, p = self.fix(three)
        if status != OK:
            return _nothing(0 if status == NOT_SEEN else 1, status)
        return self._of_place(x, three, p, prior)

    def _of_place(self, x: Vector, three: Matrix, p: Vector, prior: Prior) -> BeaconImage:
        """A fix at p, or numbers: their noise is that at the predicted place, unless an image knows it better."""
        range2 = float(prior.place @ prior.place)
        believed = prior.tight or prior.variance < self.spread2(range2) * range2
        at = prior.place if believed else p
        turn = self._cam_from_dock() if self.known else turn_of(self.rays_of(three), unit(self.three - p))
        rays = unit(self.three - at) @ turn.T
        if not (rays[:, 2] > 0.0).all():
            return _nothing(1, NO_CONVERGENCE)
        predicted = self.focal_length * rays[:, :2] / rays[:, 2:]
        if self.method == "spots":
            return self._with_noise(x, self.by_spots(predicted, ALL), numbers_of(self.rays_of(three), ALL))
        to_place = to_angles(at) @ self.dock
        swung = to_place @ self.arm_covariance @ to_place.T
        if self.exact:
            by_spots = to_angles(at) @ np.linalg.solve(self.by_place(at, ALL)[1], self.by_spots(predicted, ALL))
        else:
            by_spots = np.zeros((3, 6))
            a, b = self.half_spacing, self.c_distance
            if not solve_parallel_jacobian(predicted, self.focal_length, a, b, by_spots):
                return _nothing(1, NO_CONVERGENCE)
        return self._with_noise(x, by_spots, p, swung)

    def _with_noise(self, x: Vector, by_spots: Matrix, value: Vector, more: Matrix | float = 0.0) -> BeaconImage:
        variance = (self.spot_sigma[:3] ** 2 + self.lasting[:3, None] ** 2).ravel()
        noise = by_spots * variance @ by_spots.T + more
        k = len(by_spots)
        if not (np.isfinite(noise).all() and np.linalg.eigvalsh(noise)[0] > 0.0):
            return _nothing(1, DEGENERATE)
        groups, none = np.zeros(k, dtype=np.int64), np.zeros((k, 6))
        image = BeaconImage(1, OK, groups, np.arange(k), none, np.zeros(k), noise, np.zeros((k, 3)), by_spots, value)
        again = self.again(image, x, np.zeros((3, 2)))
        assert again is not None
        return again

    # --- of either

    def observe(self, x: Vector, spots: Matrix, prior: Prior) -> BeaconImage:
        """What of the spots (n, 2) m is used, and with which noise, linearised at a predicted state."""
        return self.see_coordinates(x, spots) if self.coordinates else self._see_numbers(x, spots, prior)

    def again(self, image: BeaconImage, x: Vector, spots: Matrix) -> BeaconImage | None:
        """The same rows at another state; None if the image is impossible there."""
        rows = np.zeros(image.rows.shape)
        if self.coordinates:
            expected, depth, slopes = self.coordinate_slopes(x)
            beacon, axis = np.divmod(image.places, 2)
            if not (depth[beacon] > 0.0).all():
                return None
            rows[:, :3] = slopes[beacon, axis, POSITION]
            return replace(image, rows=rows, residual=spots[beacon, axis] - expected[beacon, axis])
        p = self.place(x)
        if self.method == "fix":
            rows[:, :3] = to_angles(p) @ self.dock
            return replace(image, rows=rows, residual=angles_between(image.value, p))
        g, slope = self.by_place(p, _seen_by(image.by_spots))
        rows[:, :3] = slope @ self.dock
        return replace(image, rows=rows, residual=image.value - g)
