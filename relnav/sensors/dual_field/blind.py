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
from relnav.sensors.dual_field.optics import plane_points
from relnav.sensors.dual_field.pair_block import SCALE, TRIED, new_work
from relnav.sensors.dual_field.scaled_pair import try_pairs
from relnav.sensors.dual_field.search import CLUSTERING
from relnav.sensors.dual_field.sky import Sky, prepare_sky, prepare_stars
from relnav.sensors.dual_field.solution import StarSolution, StarStatus, no_solution, which_way
from relnav.sensors.dual_field.spot_template import Spots
from relnav.sensors.dual_field.star_levels import Levels, levels_for

FOCAL_RANGE = 0.05
"""How far the focal length may be from the given one, relative."""

MIRRORED_PAIRS = 12
"""Pairs that are tried to tell a user whose frame is not solved that it is mirrored."""

STARS_IN_FIELD, FEW_STARS_IN_FIELD = 25.0, 12.0
"""Catalogue stars expected in the field among which pairs are looked up; the brighter half is tried first, at a quarter
of the attitudes."""

SHEAR, LEAST_SHEAR, MOST_SHEAR = 0.01, 0.002, 0.03
"""Error of a spot relative to its distance from the pair, by distortion not known: any lens, a long one, a wide one."""

COARSENESS, WIDEST_STEP = 0.1, 0.01
"""Half the width of a step of scale, in tightest shears over the square of the field's size, and its most: by that
times the square a template is off that is written for its middle."""

REACHES = (0.5, 0.8, 1.25, 2.0, 3.2)
"""Tolerances up to which there are tables of bits, in `SHEAR` times the field's size."""

MAG_CONTRAST = 2.0
"""By how much the difference of a pair of spots' magnitudes may differ from that of their stars."""

LOG_PROMISING = math.log(1e-3)
"""An attitude that chance would give more often than this is not fitted."""

WIDE_LENS = 0.4
"""Distance of the farthest spot from the axis, in focal lengths, of a wide lens."""

ALL_SEARCHES, FIRST_SEARCH, OTHER_SEARCHES = slice(None), slice(1), slice(1, None)

LEAST_SPOTS = 6

WIDEST_RAD = math.radians(60.0)
"""Spots farther from the axis, were the focal length as given, are not used: lenses that show them are no pinholes."""

SKY_STEP = 1.25
"""Fields alike within a step of size, and of number of stars, share a sky: making one takes longer than solving the
frame. Pairs of stars that a frame does not ask for are passed over, so that a wider step costs little but memory."""

NARROWEST = 1e-3
"""Height or width, rad, below which spots are taken to cover no field."""


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
    deepest = faintest_of(catalogue, rounded_up(stars_for(points)))
    reaches = tuple(SHEAR * rounded_up(radius) * reach for reach in REACHES)
    levels = levels_for(prepare_stars(catalogue, epoch_jyear, deepest, blind.velocity_km_s), reaches)
    ways = [
        Way(as_given, SHEAR, few, first),
        Way(as_given, SHEAR, few, FAR),
        Way(spread_order(points), SHEAR, few, then),
        *(Way(half, SHEAR, few, then) for half in half_orders(points)),
        Way(as_given, SHEAR, STARS_IN_FIELD, then),
    ]
    ways += [Way(as_given, MOST_SHEAR, few, FAR)] * (radius > WIDE_LENS)
    for way, chosen in islice(zip(ways, new_pairs(points, ways), strict=True), searches.start, searches.stop):
        order, stars = way.order, way.stars_in_field
        known, faintest = -math.inf, faintest_of(catalogue, fields * stars)
        if stars == STARS_IN_FIELD:  # with fewer stars the same was tried of the brighter ones
            known = faintest_of(catalogue, fields * few)
        limits = log10_pfa, depth, (way.shear, LEAST_SHEAR), known, faintest
        fit, tried = _search(blind.of(order), points[order], sky(stars), levels, chosen, *limits, tried)
        if fit is not None:
            return fit.in_order(order).solution(sky(stars), tried)
    reason = f"no attitude with a focal length within {FOCAL_RANGE:.0%} of {blind.focal_px:g} px explains the spots"
    if here := which_way(blind.distortion):
        reason += f"; is the model's distortion{here} that of this camera?"
    if searches == FIRST_SEARCH:
        return no_solution(StarStatus.NO_MATCH, reason, n, tried=tried)
    mirrored = replace(blind, spots_px=blind.spots_px * (1.0, -1.0), lens_known=False)
    chosen = pair_order(mirrored.points, then)[:MIRRORED_PAIRS]
    limits = log10_pfa, depth, (SHEAR, LEAST_SHEAR), -math.inf, faintest_of(catalogue, fields * STARS_IN_FIELD)
    if _search(mirrored, mirrored.points, sky(STARS_IN_FIELD), levels, chosen, *limits)[0] is not None:
        reason += "; mirrored it does: x_px must count to the right and y_px down, as on the detector seen from behind"
    return no_solution(StarStatus.NO_MATCH, reason, n, tried=tried)


def _search(
    blind: Blind,
    points: Matrix,
    sky: Sky,
    levels: Levels,
    pairs: Pairs,
    log10_pfa: float,
    depth: float,
    shears: tuple[float, float],
    known: float,
    faintest: float,
    tried: int = 0,
) -> tuple[CameraFit | None, int]:
    """The first fit that is believed, and how many attitudes were tried, with those `tried` before."""
    checked = np.ascontiguousarray(points[:CHECKED_SPOTS])
    m, size = len(checked), edge(points)
    spots = Spots(
        checked,
        np.zeros(m) if blind.magnitude is None else np.ascontiguousarray(blind.magnitude[:m], dtype=np.float64),
        (0.5 / blind.focal_px) ** 2,
        np.array(shears),
        FOCAL_RANGE,
        min(WIDEST_STEP, COARSENESS * min(shears) / size**2),
        CLUSTERING * float(np.searchsorted(sky.magnitudes, depth, side="right")),
        depth,
        known,
        faintest,
        math.inf if blind.magnitude is None else MAG_CONTRAST,
    )
    number = 0
    work, table = new_work(m), np.array(pairs, dtype=np.int64).reshape(-1, 2)
    star, A, best = np.empty(m, dtype=np.int64), np.empty((3, 3)), work.best
    best[TRIED] = tried
    while True:
        number = 1 + try_pairs(spots, sky.arrays, levels, work, table, number, LOG_PROMISING, A, star)
        if number > len(table):
            return None, int(best[TRIED])
        fit = fit_camera(
            blind.spots_px,
            sky,
            star,
            dcm=A.copy(),
            focal_px=blind.focal_px / float(best[SCALE]),
            principal_px=blind.principal_px,
            distortion=blind.distortion,
            lens_known=blind.lens_known,
            tried=float(best[TRIED]),
            faintest=depth,
        )
        if (
            fit is not None
            and fit.log10_false_alarm < log10_pfa
            and abs(fit.focal_px / blind.focal_px - 1.0) < FOCAL_RANGE
        ):
            return fit, int(best[TRIED])
