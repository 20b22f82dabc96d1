"""The birefringent sun sensor against its patent: axes observed, and what the second spot is worth."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from relnav.accuracy.claims import ClaimRow, ClaimsReport, claim_row
from relnav.accuracy.published import Claim, Published
from relnav.arrays import Matrix, Vector
from relnav.sensors.birefringent_sun.crystal import polarisation_basis
from relnav.sensors.birefringent_sun.direction import fit_two_spots
from relnav.sensors.birefringent_sun.observability import observability
from relnav.sensors.birefringent_sun.polarised import polarised_roll, shares
from relnav.sensors.birefringent_sun.self_calibration import self_calibration_bound
from relnav.sensors.birefringent_sun.sensor import BirefringentSunModel, BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import spots_jacobian, spots_of_transverse

AXES, OVER_ONE, OVER_HOLE = "axes from the sun alone", "gain over one spot", "gain over a conventional sun sensor"
WIDE_FIELD = "sigma of a wide field over that of a narrow one"
NARROW_RAD = float(np.radians(30.0))
FRAMES = 1000
BEACON_PHOTONS = 1e8
TURN_RAD = 1e-5


@dataclass(frozen=True)
class DirectionSigmas:
    """1-sigma (rad, root mean square of the two axes) of single-shot directions, by what is measured.

    `hole_same_depth`: a hole at the crystal's thickness in air. `ordinary`, `extraordinary`: one spot of the crystal.
    `both`: both with the same noise each. `shared`: both, each with half of the light and sqrt(2) of the noise.
    """

    hole_same_depth: float
    ordinary: float
    extraordinary: float
    both: float
    shared: float


def direction_sigmas(sensor: BirefringentSunSensor, s: Vector) -> DirectionSigmas:
    """Cramer-Rao bounds at sun direction s (3,), from the sensor's spot noise."""
    noise = sensor.spot_noise_px * sensor.pixel_pitch_m
    J = spots_jacobian(sensor, np.asarray(s[:2]))
    z = s[2]
    hole = sensor.crystal_thickness_m * (np.eye(2) / z + np.outer(s[:2], s[:2]) / z**3)
    both = _sigma(J, s, noise)
    return DirectionSigmas(
        _sigma(hole, s, noise), _sigma(J[:2], s, noise), _sigma(J[2:], s, noise), both, np.sqrt(2.0) * both
    )


def estimated_sigma(sensor: BirefringentSunSensor, s: Vector, trials: int, rng: np.random.Generator) -> float:
    """What the estimator reaches (rad, root mean square of the two axes) over so many noisy pairs of spots."""
    noise = sensor.spot_noise_px * sensor.pixel_pitch_m
    spots = spots_of_transverse(sensor, np.asarray(s[:2]))
    fit = fit_two_spots(sensor, spots + noise * rng.normal(size=(trials, 2, 2)), noise**2 * np.eye(4))
    error = (fit.u - s[:2]) @ _to_direction(s).T
    return float(np.sqrt(0.5 * np.mean(np.sum(error**2, axis=1))))


def gain_on_the_same_detector(sensor: BirefringentSunSensor, half_angle_rad: float) -> tuple[float, float]:
    """How much better both spots are than a hole in air on the same detector: on axis, and rms over the field.

    Each has the depth with which its farthest spot just reaches the detector's edge at the edge of the field.
    """
    off = np.linspace(0.0, half_angle_rad, 25)
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    s = np.stack([directions(angle, around) for angle in off])
    reach = np.linalg.norm(spots_of_transverse(sensor, s[-1, :, :2]), axis=-1).max() / sensor.crystal_thickness_m
    depth_ratio = np.tan(half_angle_rad) / reach  # of the crystal over the hole, both on a detector of half size 1
    ours = np.array([[direction_sigmas(sensor, v).both for v in ring] for ring in s])
    hole = np.array([[direction_sigmas(sensor, v).hole_same_depth for v in ring] for ring in s])
    weight = np.sin(off)[:, None]
    rms = [np.sqrt(np.sum(weight * part**2) / np.sum(weight * np.ones_like(part))) for part in (hole, ours)]
    return float(hole[0, 0] / ours[0, 0] * depth_ratio), float(rms[0] / rms[1] * depth_ratio)


def cost_of_a_wide_field(sensor: BirefringentSunSensor, wide_rad: float, narrow_rad: float) -> tuple[float, float]:
    """Both spots' 1-sigma, rms over the field, of a wide half-angle over a narrow one: same crystal, same detector.

    On the same detector each crystal is as thick as lets the farthest spot at the edge of its field just reach the rim.
    """
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rms, reach = [], []
    for half in (wide_rad, narrow_rad):
        off = np.linspace(0.0, half, 13)
        ours = np.array([[direction_sigmas(sensor, s).both for s in directions(angle, around)] for angle in off])
        weight = np.sin(off)[:, None]
        rms.append(np.sqrt(np.sum(weight * ours**2) / (np.sum(weight) * around.size)))
        edge = spots_of_transverse(sensor, directions(half, around)[:, :2])
        reach.append(np.linalg.norm(edge, axis=-1).max())
    return float(rms[0] / rms[1]), float(rms[0] / rms[1] * reach[0] / reach[1])


def directions(off_axis_rad: float, azimuth_rad: Vector | float) -> Matrix:
    """Unit vectors (..., 3) so far off the boresight."""
    azimuth = np.asarray(azimuth_rad, dtype=np.float64)
    sine = np.sin(off_axis_rad)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.full_like(azimuth, np.cos(off_axis_rad))], -1)


def rank_with_beacon(sensor: BirefringentSunSensor, s: Vector, psi_rad: float) -> int:
    """Axes of the attitude that a polarised beacon shows, by both spots' places and the ratio of their light."""
    field = polarisation_basis(s) @ [np.cos(psi_rad), np.sin(psi_rad)]
    columns = []
    for axis in np.eye(3):
        ends = []
        for sign in (1.0, -1.0):
            seen, turned = (v - sign * TURN_RAD * np.cross(axis, v) for v in (s, field))
            seen = seen / np.linalg.norm(seen)
            angle = np.arctan2(*(polarisation_basis(seen).T @ turned)[::-1])
            light = shares(sensor, seen, float(angle))
            places = spots_of_transverse(sensor, seen[:2]).ravel() / sensor.crystal_thickness_m
            ends.append(np.append(places, np.log(light[0] / light[1])))
        columns.append((ends[0] - ends[1]) / (2.0 * TURN_RAD))
    sizes = np.linalg.svd(np.stack(columns, axis=1), compute_uv=False)
    return int(np.sum(sizes > 1e-6 * sizes[0]))


def measure(
    model: BirefringentSunModel,
    published: Published,
    *,
    runs: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> ClaimsReport:
    """Set the patent's claims beside what any crystal and this one can do.

    Parameters
    ----------
    runs : int
        Random optic axes and sun directions whose rank is looked at.
    seed : int
        Of everything random.
    progress : callable, optional
        Called with 1 after every case.
    """
    rng = np.random.default_rng(seed)
    sensor = model.sensor
    ranks, leak = np.empty(runs, dtype=np.int64), 0.0
    for k in range(runs):
        crystal = _any_crystal(sensor, rng)
        s = _random_directions(1.4, 1, rng)[0]
        seen = observability(crystal, s)
        ranks[k], leak = seen.rank, max(leak, seen.singular_values[2] / seen.singular_values[0])
        if progress is not None:
            progress(1)
    edge = sensor.field_half_angle_rad
    sigmas = [direction_sigmas(sensor, s) for s in _random_directions(edge, 400, rng)]
    both, shared, ordinary, extraordinary, hole = (
        float(np.sqrt(np.mean([getattr(entry, name) ** 2 for entry in sigmas])))
        for name in ("both", "shared", "ordinary", "extraordinary", "hole_same_depth")
    )
    figures = [
        (AXES, f"two spots, {runs} random crystals and directions", float(ranks.max())),
        (OVER_ONE, "over the ordinary, same noise in each spot", ordinary / both),
        (OVER_ONE, "over the extraordinary, same noise in each spot", extraordinary / both),
        (OVER_ONE, "light shared by the spots", ordinary / shared),
        (OVER_HOLE, "hole at the same depth", hole / both),
        (OVER_HOLE, "hole on the same detector", gain_on_the_same_detector(sensor, edge)[1]),
    ]
    wide = cost_of_a_wide_field(sensor, edge, min(NARROW_RAD, 0.5 * edge))
    figures += [(WIDE_FIELD, "same crystal", wide[0]), (WIDE_FIELD, "same detector", wide[1])]
    rows = [
        _row(claim, published, method, value)
        for claim in published.claims
        for name, method, value in figures
        if name == claim.quantity
    ]
    return ClaimsReport(model.name, runs, seed, tuple(rows), _notes(sensor, leak, rng))


def _row(claim: Claim, published: Published, method: str, value: float) -> ClaimRow:
    """A figure of which more is better, but for the price of a wide field."""
    row = claim_row(claim, published, method, value)
    return row if claim.quantity == WIDE_FIELD else replace(row, met=bool(value >= claim.value_si))


def _notes(sensor: BirefringentSunSensor, leak: float, rng: np.random.Generator) -> tuple[str, ...]:
    u = _random_directions(np.radians(30.0), FRAMES, rng)[:, :2]
    decentre = np.sqrt(np.diag(self_calibration_bound(sensor, u, ("zero_spot_x_px", "zero_spot_y_px"))))
    s = directions(np.radians(20.0), 0.5)
    light = BEACON_PHOTONS * shares(sensor, s, 0.7)
    roll, sigma = polarised_roll(sensor, s, *light.tolist()).nearest(0.7)
    places, angles = _random_directions(sensor.field_half_angle_rad, 20, rng), 3.0 * rng.random(20)
    rank = min(rank_with_beacon(sensor, place, angle) for place, angle in zip(places, angles, strict=True))
    um = decentre * sensor.pixel_pitch_m * 1e6
    return (
        f"the third singular value is at most {leak:.0e} of the first: a turn about the sun line moves no spot",
        f"{FRAMES} frames within 30 deg tell where the opening stands to {um[0]:.2f}, {um[1]:.2f} um (1 sigma), with "
        "no attitude known: no plain hole can",
        f"a polarised beacon on the target shows {rank} axes; {BEACON_PHOTONS:.0e} photons give the roll about it to "
        f"{np.degrees(sigma) * 3600.0:.1f} arcsec (1 sigma; found {roll:.6f} rad for 0.7)",
    )


def _any_crystal(sensor: BirefringentSunSensor, rng: np.random.Generator) -> BirefringentSunSensor:
    """The sensor with its optic axis turned anywhere."""
    return replace(
        sensor, axis_polar_rad=float(np.arccos(rng.random())), axis_azimuth_rad=2.0 * np.pi * float(rng.random())
    )


def _random_directions(half_angle_rad: float, count: int, rng: np.random.Generator) -> Matrix:
    """Unit vectors (count, 3), even over the cone."""
    z = rng.uniform(np.cos(half_angle_rad), 1.0, count)
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    level = np.sqrt(1.0 - z**2)
    return np.stack([level * np.cos(turn), level * np.sin(turn), z], axis=1)


def _sigma(J: Matrix, s: Vector, noise: float) -> float:
    to = _to_direction(s)
    covariance = to @ np.linalg.inv(J.T @ J) @ to.T * noise**2
    return float(np.sqrt(0.5 * np.trace(covariance)))


def _to_direction(s: Vector) -> Matrix:
    """d(s)/d(s_x, s_y), (3, 2)."""
    return np.vstack([np.eye(2), -np.asarray(s[:2]) / s[2]])
