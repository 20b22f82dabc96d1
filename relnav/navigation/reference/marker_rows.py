"""What an image of markers says to `engine="filterpy"`: one formula of the spots, and derivatives by complex steps.

Marker i at s in the target is seen at p = M (B (C s - rho) - c_B), M camera from chaser, B chaser from lvlh, c_B the
lens, through focal length, distortion and principal point. Sixteen errors are counted: drho (3), theta of the target
(3; C exp([theta x])), theta of the chaser (3), of the camera's mounting (3), the relative one of the focal length, and
the marker's place (3). A spot's derivative by an error is the imaginary part of the spot at an imaginary error (Squire
and Trapp 1998); its second derivative is the difference of two such.
"""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.mission import VisionMission
from relnav.navigation.blocks import inertia_errors
from relnav.navigation.pose_state import PoseState
from relnav.navigation.reference.motion import IMAGINARY, cross

POSITION, TURN, CHASER, MOUNTING, FOCAL, PLACE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12), 12, slice(13, 16)
ERRORS = 16
BEHIND_TURNS = 6
"""Of the considered errors."""
SEEN = np.array([0, 1, 2, 6, 7, 8])
"""Which of the twelve errors of a state (drho, dv, theta, dw) an image sees."""
SMALL = 1e-5
"""Of the range, and rad: by which second derivatives are taken."""


@dataclass(frozen=True)
class PoseTrack:
    """A hypothesis.

    Attributes
    ----------
    motion, dcm, rate : (6,), (3, 3), (3,)
        Chaser from target in `lvlh_ccsds`, dcm_lvlh_from_target, inertial rate in target axes.
    covariance : (12, 12)
        Of (drho, dv, theta, dw), without what is considered.
    considered : (m, 12)
        What one sigma of each lasting error has done to the state.
    score, doubt, prior, added : float
        Minus twice its log-likelihood; how much of that may be undeserved; what was known against it when it joined
        others; when that was.
    evidence : (m,), (m, m) or None
        What images have told of lasting errors, by this hypothesis: mean and covariance; None: nothing.
    pairs, even : (6, 6) or None
        Points about attitude and rate in a gap, a column a pair, and what they have bent (`reference.bending`).
    age_s : float
        How long the gap lasts.
    """

    motion: Vector
    dcm: Matrix
    rate: Vector
    covariance: Matrix
    considered: Matrix
    score: float = 0.0
    doubt: float = 0.0
    prior: float = 0.0
    added: float = -np.inf
    evidence: tuple[Vector, Matrix] | None = None
    pairs: Matrix | None = None
    even: Matrix | None = None
    age_s: float = 0.0

    @property
    def rank(self) -> float:
        """Minus twice the logarithm of how likely it is, up to a constant."""
        return self.score + self.prior

    def odds_against(self, lead: "PoseTrack") -> float:
        """Odds of a leading one, as `ambiguity`."""
        return self.rank - self.doubt - lead.rank

    @property
    def state(self) -> PoseState:
        """Values of their own, what is considered in the covariance."""
        covariance = self.covariance + self.considered.T @ self.considered
        return PoseState(self.motion.copy(), self.dcm.copy(), self.rate.copy(), covariance)


@dataclass(frozen=True)
class MarkerImage:
    """Spots that can be used, k markers, two rows each.

    Attributes
    ----------
    seen : int
        Spots there are, those included that cannot be used.
    which : (k,)
        Their markers.
    residual, rows, noise : (2 k,), (2 k, 12), (2 k, 2 k)
        Second order and what is considered in both.
    left : (2 k, m)
        What one sigma of each lasting error does to each row, less what the state has taken up of it.
    bending : float
        By how much the second order makes ln |noise| larger.
    """

    seen: int
    which: Codes
    residual: Vector
    rows: Matrix
    noise: Matrix
    left: Matrix
    bending: float


class MarkerOptics:
    """The camera and the markers of a mission."""

    def __init__(self, mission: VisionMission) -> None:
        """Take the model."""
        camera, tolerances = mission.camera, mission.tolerances
        self.points, self._mount = mission.markers.points_m, camera.dcm_cam_from_chaser
        self._lens, self._distortion = np.array(camera.position_m), camera.distortion
        self._focal, self._center = np.array(camera.focal_length_px), np.array(camera.principal_point_px)
        self.size, self.spot_noise = np.array(camera.image_size_px, dtype=np.float64), camera.spot_noise_px
        self.attitude_sigma = mission.chaser.attitude_sigma_rad
        self._built = tolerances if tolerances is not None and tolerances.considered else None
        self.shown = 3 if self._built is None else 7 + 3 * len(self.points)
        self.considered = self.shown + inertia_errors(mission)

    def _in_camera(self, at: PoseTrack, chaser: Matrix, which: Codes, errors: Matrix) -> Matrix:
        """Markers (..., k, 3) in camera axes, under errors (..., k, 16)."""
        s = self.points[which] + errors[..., PLACE]
        turned = cross(errors[..., TURN], s)
        s = s + turned + 0.5 * cross(errors[..., TURN], turned)  # exp([theta x]) to second order
        v = (s @ at.dcm.T - at.motion[:3] - errors[..., POSITION]) @ chaser.T
        p = (v - cross(errors[..., CHASER], v) - self._lens) @ self._mount.T
        out: Matrix = p - cross(errors[..., MOUNTING], p)
        return out

    def _distorted(self, xy: Matrix) -> Matrix:
        """Normalised image (..., 2) through the lens: Brown and Conrady's polynomial."""
        x, y = xy[..., 0], xy[..., 1]
        k1, k2, p1, p2, k3 = self._distortion
        r2 = x * x + y * y
        radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        return np.stack(
            [
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            axis=-1,
        )

    def _bend(self, xy: Matrix) -> Stack:
        """Derivative (k, 2, 2) of the distortion at (k, 2)."""
        steps = xy + 1j * IMAGINARY * np.eye(2)[:, None]
        return np.moveaxis(self._distorted(steps).imag / IMAGINARY, 0, -1)

    def derivatives(self, at: PoseTrack, chaser: Matrix, which: Codes) -> tuple[Matrix, Stack]:
        """Spots (k, 2) px as expected, and their derivatives by the sixteen errors, (k, 2, 16)."""
        errors = np.broadcast_to(1j * IMAGINARY * np.eye(ERRORS)[:, None], (ERRORS, len(which), ERRORS))
        p = self._in_camera(at, chaser, which, errors)
        spots = self._distorted(p[..., :2] / p[..., 2:]) * self._focal * (1.0 + errors[..., FOCAL, None])
        return spots[0].real + self._center, np.moveaxis(spots.imag / IMAGINARY, 0, -1)

    def _second(self, at: PoseTrack, chaser: Matrix, which: Codes, depth: Vector, bend: Stack) -> Stack:
        """Second derivatives (2 k, 6, 6) by (drho, theta), the lens's own bend left out."""
        k = len(which)
        by = np.zeros((6, 2, 6, k, ERRORS), dtype=complex)  # moved along, by which sign, differentiated by
        h = SMALL * np.where(np.arange(6)[:, None] < 3, depth, 1.0)
        for j in range(6):
            by[j, 0, :, :, j], by[j, 1, :, :, j] = h[j], -h[j]
            by[:, :, j, :, j] += 1j * IMAGINARY
        p = self._in_camera(at, chaser, which, by)
        slopes = (p[..., :2] / p[..., 2:]).imag / IMAGINARY
        second = (slopes[:, 0] - slopes[:, 1]) / (2.0 * h[:, None, :, None])  # (6, 6, k, 2)
        second = np.moveaxis(0.5 * (second + np.swapaxes(second, 0, 1)), (2, 3), (0, 1))
        out: Stack = np.einsum("a,kab,kbij->kaij", self._focal, bend, second).reshape(2 * k, 6, 6)
        return out

    def by_lasting(self, slopes: Stack, which: Codes) -> Matrix:
        """What one sigma of each lasting error does to each row, (2 k, m)."""
        k, built = len(which), self._built
        out = np.zeros((k, 2, self.considered))
        out[:, :, :3] = self.attitude_sigma * slopes[:, :, CHASER]
        if built is not None:
            out[:, :, 3:6] = built.camera_mounting_sigma_rad * slopes[:, :, MOUNTING]
            out[:, :, 6] = built.focal_length_relative_sigma * slopes[:, :, FOCAL]
            for i, marker in enumerate(which):
                first = 7 + 3 * int(marker)
                out[i, :, first : first + 3] = built.marker_placement_sigma_m * slopes[i, :, PLACE]
        return out.reshape(2 * k, self.considered)

    def turns_follow(self, dcm: Matrix, correction: Vector, chaser: Matrix) -> Matrix:
        """What each lasting error does to an estimate more, (m, 12), where that is corrected by errors (12,).

        A turn of chaser or camera by a turns all that is found: -a x of position and velocity, -C^T a of the attitude
        C = dcm. Of theta x C^T a, by which that changes, half; the rest is done where the errors are folded in.
        """
        out, turn = np.zeros((self.considered, 12)), 0.5 * cross_matrix(correction[6:9]) @ dcm.T
        turns = [(0, self.attitude_sigma, chaser)]
        if self._built is not None:
            turns.append((3, self._built.camera_mounting_sigma_rad, self._mount @ chaser))
        for first, sigma, axes in turns:
            for part in (slice(0, 3), slice(3, 6)):
                out[first : first + 3, part] = -sigma * cross(axes, correction[part])
            out[first : first + 3, 6:9] = sigma * axes @ turn.T
        return out

    def observe(
        self, at: PoseTrack, chaser: Matrix, spots: Matrix, covariances: Stack, attitude_noise: float
    ) -> MarkerImage:
        """Rows of the spots (n, 2) px about a hypothesis; covariances (n, 2, 2) px^2, or (0, 2, 2): the camera's.

        A spot off the image, or of a marker expected behind the camera or where the lens folds back, is of no use.
        """
        there = np.flatnonzero(np.isfinite(spots).all(axis=1))
        p = self._in_camera(at, chaser, there, np.zeros((len(there), ERRORS)))
        good = p[:, 2] > 0.0
        xy = p[:, :2] / np.where(good, p[:, 2], 1.0)[:, None]
        bend = self._bend(xy)
        good &= np.linalg.det(bend) > 0.0
        good &= ((spots[there] >= -0.5) & (spots[there] <= self.size - 0.5)).all(axis=1)
        which, depth, bend = there[good], p[good, 2], bend[good]
        expected, slopes = self.derivatives(at, chaser, which)
        rows = np.zeros((2 * len(which), 12))
        rows[:, SEEN] = slopes[:, :, :6].reshape(-1, 6)
        left = self.by_lasting(slopes, which) - rows @ at.considered.T
        turns = attitude_noise * slopes[:, :, CHASER].reshape(-1, 3)
        noise = turns @ turns.T + left @ left.T
        for i, marker in enumerate(which):
            own = covariances[marker] if len(covariances) else self.spot_noise**2 * np.eye(2)
            noise[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += np.tril(own) + np.tril(own, -1).T
        lasting = at.considered[min(BEHIND_TURNS, self.shown) :, SEEN]  # turns of the camera leave the view
        spread = at.covariance[np.ix_(SEEN, SEEN)] + lasting.T @ lasting
        bent = self._second(at, chaser, which, depth, bend) @ spread
        mean = 0.5 * np.trace(bent, axis1=1, axis2=2)
        curved = noise + 0.5 * np.einsum("iab,jba->ij", bent, bent)
        bending = max(0.0, _log_determinant(curved) - _log_determinant(noise))
        residual = (spots[which] - expected).ravel() - mean
        return MarkerImage(len(there), which, residual, rows, curved, left, bending)


def _log_determinant(matrix: Matrix) -> float:
    """Logarithm of the determinant; zero where it is not positive definite."""
    if len(matrix) == 0:
        return 0.0
    sign, value = np.linalg.slogdet(matrix)
    return float(value) if sign > 0.0 else 0.0
