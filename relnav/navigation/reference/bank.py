"""Hypotheses of `engine="filterpy"`: carried, corrected by an image on filterpy, ordered, and one told from another."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.estimation.reference import ReferenceTrack, believed
from relnav.geometry.linear_algebra import cross_matrix
from relnav.mission import VisionMission
from relnav.navigation.blocks import MOUNTING, marker_shown
from relnav.navigation.pose_filter import DROP, JOINED, JOINED_LATE, MARGIN, TELLING_SHARE
from relnav.navigation.pose_propagation import MEMORY_S
from relnav.navigation.pose_update import LONE_SHARE, SETTLING_S
from relnav.navigation.reference.bending import over_a_step, with_pairs
from relnav.navigation.reference.inertia import errors_of, inertia_effect, second_order_density
from relnav.navigation.reference.marker_rows import MarkerImage, MarkerOptics, PoseTrack
from relnav.navigation.reference.motion import predict_motion, predict_rotation, rate_and_gravity

_TURN, _RATE = slice(6, 9), slice(9, 12)


@dataclass(frozen=True)
class Exposure:
    """An image: when, the chaser's attitude (3, 3) with the noise of what is new in it, spots, their covariances."""

    t_s: float
    chaser: Matrix
    attitude_noise: float
    spots: Matrix
    covariances: Stack

    @property
    def seen(self) -> int:
        """How many spots there are."""
        return int(np.count_nonzero(np.isfinite(self.spots).all(axis=1)))


@dataclass(frozen=True)
class Corrected:
    """A hypothesis after an image: how many spots there were, which markers could be used and were, NIS of the former.

    share: of the image, that the largest gate covered; bending: as of `MarkerImage`; width: ln |S| of the used ones.
    """

    track: PoseTrack
    seen: int
    which: Codes
    used: Codes
    nis: float
    share: float
    bending: float
    width: float = 0.0


def turned_by(dcm: Matrix, vector: Vector) -> Matrix:
    """A rotation turned by a rotation vector, dcm exp([vector x]), by scipy."""
    from scipy.spatial.transform import Rotation

    out: Matrix = dcm @ Rotation.from_rotvec(vector).as_matrix()
    return out


def turn_between(dcm: Matrix, reference: Matrix) -> Vector:
    """The rotation vector with dcm = reference exp([vector x]), by scipy."""
    from scipy.spatial.transform import Rotation

    out: Vector = Rotation.from_matrix(reference.T @ dcm).as_rotvec()
    return out


def with_inertia(track: PoseTrack, shown: int) -> Vector:
    """Variances of the errors (12,), with what the inertia's have done: those behind the `shown` ones."""
    out: Vector = np.diag(track.covariance) + np.sum(track.considered[shown:] ** 2, axis=0)
    return out


def carried(
    mission: VisionMission,
    track: PoseTrack,
    t_s: float,
    dt_s: float,
    push: Vector,
    impulse: Vector,
    *,
    bends: bool = False,
) -> PoseTrack | None:
    """A hypothesis after dt from t; None if nothing is known of its attitude, or of anything, after it.

    bends: what its turn does in second order is followed.
    """
    shown = marker_shown(mission)
    variance = with_inertia(track, shown)
    drift = mission.target.rate_noise_density_rad2_s3 * dt_s**3 / 3.0
    if not variance[_TURN].max() + variance[_RATE].max() * dt_s**2 + drift <= math.pi**2:
        return None
    orbit = rate_and_gravity(mission.orbit, t_s + 0.5 * dt_s)
    inertia, density = np.array(mission.target.inertia_kg_m2), mission.target.rate_noise_density_rad2_s3
    sigma, is_off = np.array(mission.target.inertia_sigma_kg_m2), shown < len(track.considered)
    own = {"more": partial(second_order_density, inertia, sigma, orbit)} if is_off else {}
    rotation = predict_rotation(inertia, orbit, track.dcm, track.rate, dt_s, density, **own)
    if rotation is None:
        return None
    dcm, rate, turning, turn_noise = rotation

    def turn(at: Matrix, fast: Vector, error: Matrix | float) -> tuple[Matrix, Vector]:
        moved = predict_rotation(inertia + error, orbit, at, fast, dt_s, density)
        return (at, fast) if moved is None else moved[:2]

    off = list(zip(track.considered[shown:, 6:], errors_of(sigma), strict=False))
    track = with_pairs(track, variance, len(off), dt_s, orbit[0]) if bends else track
    pairs, even = over_a_step(track, dcm, rate, turning, turn, off)
    motion, motion_noise, effect = predict_motion(mission.orbit, mission.process_noise, t_s, dt_s, push, impulse)
    phi, q = np.zeros((12, 12)), np.zeros((12, 12))
    phi[:6, :6], phi[6:, 6:], q[:6, :6], q[6:, 6:] = motion, turning, motion_noise, turn_noise
    if not np.isfinite(q).all():
        return None
    considered = track.considered @ phi.T
    if is_off:
        considered[shown:, 6:] += inertia_effect(inertia, sigma, orbit, track.dcm, track.rate, dt_s)
    ekf, fade = ReferenceTrack(np.zeros(12), track.covariance), math.exp(-dt_s / MEMORY_S)
    ekf.time_update(phi, np.zeros(12), q)
    return PoseTrack(
        motion @ track.motion + effect,
        dcm,
        rate,
        _symmetric(ekf.covariance),
        considered,
        fade * track.score,
        fade * track.doubt,
        track.prior,
        track.added,
        _faded(track.evidence, fade),
        pairs,
        even,
        track.age_s,
    )


def _faded(evidence: tuple[Vector, Matrix] | None, share: float) -> tuple[Vector, Matrix] | None:
    """A share of what images have told."""
    if evidence is None:
        return None
    mean, covariance = evidence
    return share * mean, share * covariance + (1.0 - share) * np.eye(len(mean))


def _surprise(track: PoseTrack, view: MarkerImage, spread: Matrix, rows: Codes) -> tuple[float, tuple[Vector, Matrix]]:
    """What rows cost where lasting errors are known by the images before, and what is known of them then."""
    g, size = view.left[rows], view.left.shape[1]
    mean, covariance = track.evidence or (np.zeros(size), np.eye(size))
    s = spread[np.ix_(rows, rows)] - g @ g.T + g @ covariance @ g.T
    off, gain = view.residual[rows] - g @ mean, np.linalg.solve(s, g @ covariance).T
    cost = float(off @ np.linalg.solve(s, off) + np.linalg.slogdet(s)[1])
    return cost, (mean + gain @ off, _symmetric(covariance - gain @ g @ covariance))


def corrected(
    optics: MarkerOptics,
    limits: Vector,
    track: PoseTrack,
    image: Exposure,
    lead: Corrected | None = None,
    *,
    compared: bool = False,
) -> Corrected:
    """Take an image in. A rejected spot costs what one at the gate's limit would, an image at most what all of it does.

    Of an image of which half the spots or more contradict the hypothesis nothing is used, nor is a lone spot through a
    wide gate. limits (2 n,): chi-square, of degrees of freedom from one on. lead: of the leading one, if that is
    another. compared: with others, in which lasting errors, of more than the chaser's attitude, count once.
    """
    view = optics.observe(track, image.chaser, image.spots, image.covariances, image.attitude_noise)
    count, limit = len(view.which), float(limits[1])
    score = track.score + (view.seen - count) * (limit + 4.0 * math.log(optics.spot_noise))
    if count == 0:
        return Corrected(replace(track, score=score), view.seen, view.which, view.which, math.nan, 0.0, 0.0)
    spread = view.rows @ track.covariance @ view.rows.T + view.noise

    def nis(groups: list[int]) -> float:
        rows = _rows(groups)
        return float(view.residual[rows] @ np.linalg.solve(spread[np.ix_(rows, rows)], view.residual[rows]))

    used = believed(list(range(count)), nis, lambda groups: float(limits[2 * len(groups) - 1]))
    areas = [math.sqrt(max(0.0, _determinant(spread, k))) for k in range(count)]
    share = math.pi * limit * max(areas) / float(np.prod(optics.size))
    lone = view.seen == 1 and len(used) == 1 and not share < LONE_SHARE
    if (view.seen > 1 and 2 * len(used) <= view.seen) or lone:
        used = []
    every, width = list(range(count)), 0.0
    whole = nis(every)
    cost = sum(limit + math.log(_determinant(spread, k)) for k in every if k not in used)
    after = track
    if used:
        width = _log_determinant(spread, used)
        if compared and optics.considered > MOUNTING:
            told, evidence = _surprise(track, view, spread, _rows(used))
            cost, track = cost + told, replace(track, evidence=evidence)
        else:
            cost += nis(used) + width
        doubt = view.bending + min(1.0, view.bending) * max(0.0, nis(used) - 2.0 * len(used))
        if image.t_s - track.added <= SETTLING_S:
            known = _log_determinant(view.noise, used)
            if lead is not None and len(lead.used) == len(used):
                known = max(known, lead.width)
            doubt += max(0.0, width - known)
        after = _taken_in(optics, replace(track, doubt=track.doubt + doubt), view, used, image.chaser)
    if len(used) < count:
        cost = min(whole + _log_determinant(spread, every), cost)
    after = replace(after, score=score + cost)
    return Corrected(after, view.seen, view.which, view.which[used], whole, share, view.bending, width)


def _taken_in(optics: MarkerOptics, track: PoseTrack, view: MarkerImage, used: list[int], chaser: Matrix) -> PoseTrack:
    """The update on filterpy, what it says of the errors folded into the state, and what is considered with it."""
    rows = _rows(used)
    of_inertia, left = track.considered[optics.shown :], view.left[rows, optics.shown :]
    h, r = view.rows[rows], view.noise[np.ix_(rows, rows)] - left @ left.T
    ekf = ReferenceTrack(np.zeros(12), track.covariance + of_inertia.T @ of_inertia)
    ekf.measurement_update(h, r, view.residual[rows])
    x, covariance = ekf.state, _symmetric(ekf.covariance)
    gain = np.linalg.solve(r, h @ covariance).T
    if len(of_inertia):
        rest = np.eye(12) - gain @ h
        covariance = rest @ track.covariance @ rest.T + gain @ r @ gain.T
    considered = track.considered + (gain @ view.left[rows]).T + optics.turns_follow(track.dcm, x, chaser)
    reset = np.eye(12)
    reset[_TURN, _TURN] -= 0.5 * cross_matrix(x[_TURN])
    return replace(
        track,
        motion=track.motion + x[:6],
        dcm=turned_by(track.dcm, x[_TURN]),
        rate=track.rate + x[_RATE],
        covariance=_symmetric(reset @ covariance @ reset.T),
        considered=considered @ reset.T,
    )


def ordered(tracks: list[PoseTrack], far_behind: float, t_s: float) -> tuple[list[PoseTrack], list[PoseTrack]]:
    """The most credible first, those far behind and those that have become one with a better one left out.

    far_behind: for hypotheses of the start; DROP for those taken up beside others. The second list: those far behind.
    """
    kept: list[PoseTrack] = []
    fell: list[PoseTrack] = []
    for one in sorted(tracks, key=lambda track: track.rank):
        limit = far_behind
        if one.added > -math.inf and kept:
            limit = max(DROP, one.prior - kept[0].prior + MARGIN)
        if kept and one.odds_against(kept[0]) > limit:
            fell.append(one)
            continue
        apart = all(_distance2(better, one) > JOINED for better in kept)
        if -math.inf < one.added < t_s - SETTLING_S:
            apart = apart and all(_distance2(one, better) > JOINED_LATE for better in kept)
        if apart:
            kept.append(one)
    return kept, fell


def is_exchanged(optics: MarkerOptics, limits: Vector, track: PoseTrack, image: Exposure) -> bool:
    """Whether the image fits a hypothesis once two of its spots change places, or its three go round."""
    for spots in _exchanges(image.spots, image.seen):
        view = optics.observe(track, image.chaser, spots, image.covariances, image.attitude_noise)
        count = len(view.which)
        if count < view.seen:
            continue
        spread = view.rows @ track.covariance @ view.rows.T + view.noise
        area = max(math.sqrt(max(0.0, _determinant(spread, k))) for k in range(count))
        small = math.pi * limits[1] * area < TELLING_SHARE * float(np.prod(optics.size))
        if small and view.residual @ np.linalg.solve(spread, view.residual) <= limits[2 * count - 1]:
            return True
    return False


def _exchanges(spots: Matrix, seen: int) -> Iterator[Matrix]:
    there = np.flatnonzero(np.isfinite(spots).all(axis=1)).tolist()
    orders: list[tuple[int, ...]] = [(i, j, j, i) for i, j in itertools.combinations(there, 2)]
    if seen == 3:
        a, b, c = there
        orders += [(a, b, c, b, c, a), (a, b, c, c, a, b)]
    for order in orders:
        half, out = len(order) // 2, spots.copy()
        out[list(order[:half])] = spots[list(order[half:])]
        yield out


def _distance2(one: PoseTrack, other: PoseTrack) -> float:
    """Chi-square of twelve between two hypotheses, by the covariance of the first."""
    turn = turn_between(other.dcm, one.dcm)
    e = np.concatenate([other.motion - one.motion, turn, other.rate - one.rate])
    return float(e @ np.linalg.solve(one.covariance, e))


def _rows(groups: list[int]) -> Codes:
    return np.ravel([(2 * k, 2 * k + 1) for k in groups]).astype(int)


def _determinant(spread: Matrix, k: int) -> float:
    """Of the two rows of a group by itself."""
    return float(np.linalg.det(spread[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]))


def _log_determinant(matrix: Matrix, groups: list[int]) -> float:
    rows = _rows(groups)
    return float(np.linalg.slogdet(matrix[np.ix_(rows, rows)])[1])


def _symmetric(matrix: Matrix) -> Matrix:
    out: Matrix = 0.5 * (matrix + matrix.T)
    return out
