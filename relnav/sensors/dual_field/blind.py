"""Solve a single-field frame whose focal length is known to a few percent and whose distortion is not known.

A pair of spots taken for a pair of stars gives the attitude and the focal length; the other spots are looked for with a
tolerance that grows with their distance, as an unknown distortion does. The best candidates are then fitted with focal
length and distortion as unknowns, and believed only if the tight match that is left cannot be chance and the bright
stars that should be in the frame are.
"""

import math
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.sensors.dual_field.blind_order import (
    CHECKED_SPOTS,
    CLOSER,
    CLOSEST,
    FAR,
    NARROW,
    NEAR,
    WIDE,
    Pairs,
    Way,
    edge,
    half_orders,
    new_pairs,
    pair_order,
    spread_order,
)
from relnav.sensors.dual_field.camera_fit import CameraFit, fit_camera
from relnav.sensors.dual_field.catalogue import StarCatalogue
from relnav.sensors.dual_field.identify import make_frame
from relnav.sensors.dual_field.matching import Frame, match_loosely
from relnav.sensors.dual_field.optics import plane_points, rays
from relnav.sensors.dual_field.pair_table import k_range
from relnav.sensors.dual_field.screening import (
    QUESTIONS,
    attitude_of_triads,
    extent,
    prepare_questions,
    promising,
    spot_triad,
    star_triad,
)
from relnav.sensors.dual_field.search import WORK_ROWS, count_stars, log_false_alarm
from relnav.sensors.dual_field.sky import Sky, SkyArrays, prepare_sky
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution

FOCAL_RANGE = 0.05
"""How far the focal length may be from the given one, relative."""

MIRRORED_PAIRS = 12
"""Pairs that are tried to tell a user whose frame is not solved that it is mirrored."""

STARS_IN_FIELD, FEW_STARS_IN_FIELD = 25.0, 12.0
"""Catalogue stars expected in the field among which pairs are looked up; the brighter half is tried first, at a quarter
of the attitudes."""

SHEAR, LEAST_SHEAR, MOST_SHEAR = 0.01, 0.002, 0.03
"""Error of a spot relative to its distance from the pair, by distortion not known: any lens, a long one, a wide one."""

COARSENESS = 0.05
"""Half the width of a step of scale, in shears: the questions of a pair of spots serve all pairs of stars in one step,
with a tolerance that is wider by twice that."""

WIDE_LENS = 0.4
"""Distance of the farthest spot from the axis, in focal lengths, of a wide lens."""

ALL_SEARCHES, FIRST_SEARCH, OTHER_SEARCHES = slice(None), slice(1), slice(1, None)

LEAST_FOUND = 3
"""Spots that must find a star beside the pair before a candidate is looked at."""

LEAST_SPOTS, FAINT = 6, 30.0  # the latter is a magnitude beyond all

WIDEST_RAD = math.radians(60.0)
"""Spots farther from the axis, were the focal length as given, are not used: lenses that show them are no pinholes."""

SKY_STEP = 1.25
"""Fields alike within a step of size, and of number of stars, share a sky: making one takes longer than solving the
frame. Pairs of stars that a frame does not ask for are passed over, so that a wider step costs little but memory."""

NARROWEST = 1e-3
"""Height or width, rad, below which spots are taken to cover no field."""


@kernel
def scale_of_pair(points: Matrix, i: int, j: int, angle: float) -> float:
    """Factor by which the plane points i and j are to be moved out to stand at `angle` from one another."""
    x, y, p, q = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    dot, a, c = x * p + y * q, x * x + y * y, p * p + q * q
    scale = 1.0
    for _ in range(6):  # the angle is almost proportional to the scale
        s2 = scale * scale
        cosine = (1.0 + s2 * dot) / math.sqrt((1.0 + s2 * a) * (1.0 + s2 * c))
        scale *= angle / math.acos(min(1.0, cosine))
    return scale


@kernel
def scale_rays(points: Matrix, scale: float, first: int, count: int, W: Matrix) -> None:
    """Write the unit rays of some of the plane points (n, 2), moved out, into W (n, 3): from `first` on, cyclically."""
    n = points.shape[0]
    for step in range(count):
        k = (first + step) % n
        x, y = scale * points[k, 0], scale * points[k, 1]
        norm = math.sqrt(1.0 + x * x + y * y)
        W[k, 0], W[k, 1], W[k, 2] = x / norm, y / norm, 1.0 / norm


@kernel
def ask_at_angle(
    frame: Frame, points: Matrix, i: int, j: int, angle: float, stretch: float, work: Matrix, questions: Matrix
) -> None:
    """Prepare the questions of spots i and j, standing at `angle` from one another; `stretch` is as `SHEAR`."""
    n = frame.sigma2.shape[0]
    asked, ways, _ = extent(n, 1, LEAST_FOUND)
    scale = scale_of_pair(points, i, j, angle)
    scale_rays(points, scale, i, 1, frame.W)
    scale_rays(points, scale, j, min(n, asked + 3), frame.W)  # those that are asked follow j
    spot_triad(frame.W, i, j, work[15:18], work[8:10])
    prepare_questions(frame, i, j, 0, work[15:18], asked, ways, stretch * stretch, questions)


@kernel
def try_scaled_pair(
    frame: Frame,
    sky: SkyArrays,
    points: Matrix,
    i: int,
    j: int,
    fainter: float,
    contrast: float,
    shear: float,
    known: float,
    faintest: float,
    best_A: Matrix,
    best_match: Codes,
    match: Codes,
    work: Matrix,
    info: Vector,
) -> float:
    """The best candidate of one pair of spots: the logarithm of its false alarm probability; writes attitude and match.

    info (2,): attitudes tried so far (counted on), scale of the best. `contrast` bounds the difference of the two
    differences of magnitude, `shear` is as `SHEAR`. Two stars not fainter than `known`, and pairs with one fainter than
    `faintest`, are passed over. Rows of frame.W are scratch.
    """
    n = frame.sigma2.shape[0]
    A, out, spots, stars = work[10:13], work[13], work[15:18], work[21:24]
    asked, ways, least = extent(n, 1, LEAST_FOUND)
    questions = work[24:44].reshape((QUESTIONS, 5))
    x, y, u, w = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    cosine = (1.0 + x * u + y * w) / math.sqrt((1.0 + x * x + y * y) * (1.0 + u * u + w * w))
    angle = math.acos(min(1.0, cosine))
    low, high = math.cos(angle * (1.0 + FOCAL_RANGE)), math.cos(angle * (1.0 - FOCAL_RANGE))
    first, last = k_range(sky.cosines, sky.k, sky.line, low, high)
    half_step, asked_to, best = COARSENESS * shear, -2.0, 0.0
    for pair in range(first, last):
        magnitude, other = sky.stars[sky.pairs[pair, 0], 3], sky.stars[sky.pairs[pair, 1], 3]
        step, fainter_star = other - magnitude, max(magnitude, other)
        if not known < fainter_star <= faintest or min(abs(step - fainter), abs(step + fainter)) > contrast:
            continue
        if sky.cosines[pair] > asked_to:  # they ascend
            angle = math.acos(sky.cosines[pair])
            stretch = shear + 2.0 * half_step
            ask_at_angle(frame, points, i, j, angle * (1.0 - half_step), stretch, work, questions)
            asked_to = math.cos(angle * (1.0 - 2.0 * half_step))
        apart = star_triad(sky.stars, frame.beta, sky.pairs[pair, 0], sky.pairs[pair, 1], stars, work[4:8])
        for order in range(2):
            sign, a, c = 1.0 - 2.0 * order, sky.pairs[pair, order], sky.pairs[pair, 1 - order]
            if abs(sign * step - fainter) > contrast:
                continue
            info[0] += 1.0
            if not (apart and promising(frame, sky, questions, asked, ways, least, stars, sign)):
                continue
            scale = scale_of_pair(points, i, j, math.acos(sky.cosines[pair]))
            scale_rays(points, scale, 0, n, frame.W)
            spot_triad(frame.W, i, j, spots, work[8:10])
            attitude_of_triads(spots, stars, sign, A)
            found = match_loosely(frame, sky, i, j, 0, shear * shear, A, match, out)
            if found < LEAST_FOUND:
                continue
            chance = log_false_alarm(info[0], n, found, out[0])
            if chance < best:
                best, info[1] = chance, scale
                match[i, 0], match[j, 0] = a, c
                for r in range(3):
                    for k in range(3):
                        best_A[r, k] = A[r, k]
                for k in range(n):
                    best_match[k, 0] = match[k, 0]
    return best


@dataclass(frozen=True)
class Blind:
    """A frame to be solved without its focal length.

    Attributes
    ----------
    spots_px : (n, 2)
        From the image's centre, x right, y down, brightest first.
    magnitude : (n,) or None
        Up to a constant.
    focal_px, principal_px, distortion : float, (2,), (2,)
        Start of all three; the last two are kept if `lens_known`.
    lens_known : bool
        Whether `principal_px` and `distortion` are those of the camera; else they are estimated.
    velocity_km_s : (3,) or None
        Observer's barycentric velocity, ICRS; None without aberration.
    """

    spots_px: Matrix
    magnitude: Vector | None
    focal_px: float
    principal_px: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, float] = (0.0, 0.0)
    lens_known: bool = False
    velocity_km_s: tuple[float, float, float] | None = None

    def of(self, order: Codes) -> "Blind":
        """With its spots in another order (n,)."""
        known = None if self.magnitude is None else self.magnitude[order]
        return replace(self, spots_px=self.spots_px[order], magnitude=known)

    @property
    def points(self) -> Matrix:
        """On the plane z = 1, with the focal length as given."""
        return plane_points(self.spots_px, self.focal_px, self.principal_px, self.distortion)


def faintest_of(catalogue: StarCatalogue, count: float) -> float:
    """Down to which magnitude the sky has so many stars."""
    return float(catalogue.hp_mag[min(len(catalogue), int(count)) - 1])


def fields_in_sky(points: Matrix) -> float:
    """How many fields as large as the spots (n, 2) cover make the whole sky."""
    return 4.0 * math.pi / max(float(np.prod(np.ptp(points, axis=0))), 1e-4)


def stars_for(points: Matrix) -> float:
    """Stars of the whole sky that a frame of spots (n, 2) is matched to: more in its field than it has spots."""
    return fields_in_sky(points) * max(2.0 * STARS_IN_FIELD, 1.5 * len(points))


def rounded_up(value: float) -> float:
    """The least power of `SKY_STEP` that is not less than a positive value."""
    return float(SKY_STEP ** math.ceil(math.log(value, SKY_STEP)))


def sky_for(
    catalogue: StarCatalogue,
    epoch_jyear: float,
    points: Matrix,
    velocity_km_s: tuple[float, float, float] | None,
    stars_in_field: float = STARS_IN_FIELD,
    farthest: float = FAR,
) -> Sky:
    """The sky for a field as large as the spots (n, 2) on the plane z = 1 cover: as deep as they are many.

    Pairs of stars up to `farthest` of pairs of spots, as `FAR`. Sizes and numbers are rounded by `SKY_STEP`.
    """
    size = rounded_up(edge(points))
    return prepare_sky(
        catalogue,
        epoch_jyear,
        faintest_of(catalogue, rounded_up(stars_for(points))),
        faintest_of(catalogue, rounded_up(fields_in_sky(points) * stars_in_field)),
        CLOSEST * (1.0 - FOCAL_RANGE) * math.atan(size / SKY_STEP),
        min((1.0 + FOCAL_RANGE) * farthest * size, 1.3 * math.atan(size), 1.5),
        velocity_km_s,
    )


def solve_blind(
    blind: Blind,
    catalogue: StarCatalogue,
    epoch_jyear: float,
    log10_pfa: float = -8.0,
    *,
    searches: slice = ALL_SEARCHES,
    tried: int = 0,
) -> StarSolution:
    """Attitude, focal length and distortion of a single-field frame, or a status with the reason why not.

    Parameters
    ----------
    blind : Blind
        Spots and what is known of the camera; its focal length within `FOCAL_RANGE`.
    catalogue : StarCatalogue
        Stars.
    epoch_jyear : float
        For their proper motion.
    log10_pfa : float
        Decimal logarithm of the false alarm probability that is accepted.
    searches : slice
        Which of the searches are made, one after the other, each longer than that before.
    tried : int
        Attitudes that were tried in those that were made before.
    """
    n = len(blind.spots_px)
    if n < LEAST_SPOTS:
        where = f"within {math.degrees(WIDEST_RAD):.0f} deg of the axis"
        reason = f"{n} spots {where}; with unknown focal length {LEAST_SPOTS} or more are needed"
        return no_solution(StarStatus.TOO_FEW, reason, n)
    points = blind.points
    if float(np.min(np.ptp(points, axis=0))) < NARROWEST:
        reason = "the spots cover no field: all lie in one place or along one line"
        return no_solution(StarStatus.NO_MATCH, reason, n)

    def sky(stars_in_field: float) -> Sky:
        farthest = FAR if stars_in_field == few else then
        return sky_for(catalogue, epoch_jyear, points, blind.velocity_km_s, stars_in_field, farthest)

    radius, fields, depth = edge(points), fields_in_sky(points), faintest_of(catalogue, stars_for(points))
    first, then = (FAR, FAR) if radius > WIDE else (NEAR, NEAR if radius > NARROW else CLOSER)
    as_given, few = np.arange(n), FEW_STARS_IN_FIELD
    ways = [
        Way(as_given, SHEAR, few, first),
        Way(as_given, LEAST_SHEAR, few, FAR),  # a long lens hardly distorts, and far pairs are the surest
        Way(spread_order(points), SHEAR, few, then),
        *(Way(half, SHEAR, few, then) for half in half_orders(points)),
        Way(as_given, SHEAR, STARS_IN_FIELD, then),
    ]
    ways += [Way(as_given, SHEAR, few, FAR)] * (radius > NARROW)
    ways += [Way(as_given, MOST_SHEAR, few, FAR)] * (radius > WIDE_LENS)
    for way, chosen in islice(zip(ways, new_pairs(points, ways), strict=True), searches.start, searches.stop):
        order, stars = way.order, way.stars_in_field
        known, faintest = -math.inf, faintest_of(catalogue, fields * stars)
        if stars == STARS_IN_FIELD:  # with fewer stars the same was tried of the brighter ones
            known = faintest_of(catalogue, fields * few)
        limits = log10_pfa, depth, way.shear, known, faintest
        fit, tried = _search(blind.of(order), points[order], sky(stars), chosen, *limits, tried)
        if fit is not None:
            return fit.in_order(order).solution(sky(stars), tried)
    reason = f"no attitude with a focal length within {FOCAL_RANGE:.0%} of {blind.focal_px:g} px explains the spots"
    if searches == FIRST_SEARCH:
        return no_solution(StarStatus.NO_MATCH, reason, n, tried=tried)
    mirrored = replace(blind, spots_px=blind.spots_px * (1.0, -1.0), lens_known=False)
    chosen = pair_order(mirrored.points, then)[:MIRRORED_PAIRS]
    limits = log10_pfa, depth, SHEAR, -math.inf, faintest_of(catalogue, fields * STARS_IN_FIELD)
    if _search(mirrored, mirrored.points, sky(STARS_IN_FIELD), chosen, *limits)[0] is not None:
        reason += "; mirrored it does: x_px must count to the right and y_px down, as on the detector seen from behind"
    return no_solution(StarStatus.NO_MATCH, reason, n, tried=tried)


def _search(
    blind: Blind,
    points: Matrix,
    sky: Sky,
    pairs: Pairs,
    log10_pfa: float,
    depth: float,
    shear: float,
    known: float,
    faintest: float,
    tried: int = 0,
) -> tuple[CameraFit | None, int]:
    """The first fit that is believed, and how many attitudes were tried, with those `tried` before."""
    checked = np.ascontiguousarray(points[:CHECKED_SPOTS])
    m = len(checked)
    sigma = np.full(m, 0.5 / blind.focal_px)
    frame = make_frame(rays(checked), sigma, np.full(m, -FAINT), depth + FAINT, None, None)  # not fainter than depth
    magnitude = np.zeros(m) if blind.magnitude is None else np.asarray(blind.magnitude[:m], dtype=np.float64)
    limits = math.inf if blind.magnitude is None else 2.0, shear, known, faintest
    count_stars(frame, sky.arrays)
    match, best_match = np.zeros((m, 2), dtype=np.int64), np.zeros((m, 2), dtype=np.int64)
    A, work, info = np.empty((3, 3)), np.empty((WORK_ROWS, 3)), np.array([float(tried), 0.0])
    for i, j in pairs:
        fainter = magnitude[j] - magnitude[i]
        chance = try_scaled_pair(frame, sky.arrays, checked, i, j, fainter, *limits, A, best_match, match, work, info)
        if chance > math.log(1e-3):
            continue
        fit = fit_camera(
            blind.spots_px,
            sky,
            best_match[:, 0],
            dcm=A.copy(),
            focal_px=blind.focal_px / info[1],
            principal_px=blind.principal_px,
            distortion=blind.distortion,
            lens_known=blind.lens_known,
            tried=float(info[0]),
            faintest=depth,
        )
        if (
            fit is not None
            and fit.log10_false_alarm < log10_pfa
            and abs(fit.focal_px / blind.focal_px - 1.0) < FOCAL_RANGE
        ):
            return fit, int(info[0])
    return None, int(info[0])
