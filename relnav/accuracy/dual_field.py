"""Accuracy of a star sensor against truth and against its patent: identification, attitude, the patent's formulas."""

import math
from collections.abc import Callable
from dataclasses import replace

from relnav.accuracy.claims import ClaimRow, ClaimsReport, claim_row
from relnav.accuracy.dual_field_patent import cross_angle_error, detector_use, spurious_quadruples
from relnav.accuracy.dual_field_pictures import occupancy, stray_over_star
from relnav.accuracy.dual_field_runs import FieldRuns, calibrated, fly_frames, identification_rates
from relnav.accuracy.published import Claim, Published
from relnav.sensors.dual_field.prediction import patent_roll_readings
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.simulation.star_field import SkyConditions
from relnav.simulation.star_picture import Exposure

AXES = ("x", "y", "z")
FALSE_SPOTS = (0, 1, 2, 3, 5)
BAFFLE = 1e-9
"""Share of the sun's light that a baffle lets past, as the patent asks of it."""
OURS = "pairs of one field"
PATENT = "patent, exact angle"
LITERAL = "patent, 90 deg -+ a as printed"


def measure(
    sensor: StarSensor,
    published: Published,
    *,
    runs: int,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> ClaimsReport:
    """Fly `runs` simulated frames with one field and, where the sensor has them, with two; set both against the claims.

    Spots carry the model's noise, 3 false ones and gaps of 5 %; the observer moves at 30.3 km/s. The two-field sensor
    sees 0.75 mag less deep than the same lens without its half mirror. The patent's figures are of noise alone: they
    are measured with the fold known exactly, and a note says what its stated error makes of them.
    """
    claims = {claim.quantity: claim for claim in published.claims}
    single = fly_frames(sensor, SkyConditions(faintest_mag=6.5 if claims else 5.75), runs, seed, two_fields=False)
    rows, notes = [], [_note("one field", single)]
    dual = None
    if sensor.fold.kind != "none":
        dual = fly_frames(calibrated(sensor), SkyConditions(), runs, seed, two_fields=True, progress=progress)
        notes.append(_note("two fields", dual))
        if sensor.fold.error_rad > 0.0:
            stated = fly_frames(sensor, SkyConditions(), runs, seed, two_fields=True)
            notes.append(_note("two fields, the fold off by its stated error", stated) + _rms_note(stated))
        rows.extend(_attitude_rows(claims, published, dual))
        rows.extend(_identification_rows(sensor, claims, published, dual, runs, seed))
    elif progress is not None:
        progress(runs)
    rows.extend(_single_rows(claims, published, single))
    if dual is not None and "detector use" in claims:
        rows.extend(_formula_rows(sensor, claims, published, single, runs, seed))
        rows.extend(_detector_rows(sensor, claims, published, runs, seed))
    return ClaimsReport(sensor.name, runs, seed, tuple(rows), tuple(notes))


def _note(name: str, runs: FieldRuns) -> str:
    solved = f"{runs.solved} of {runs.frames} frames solved, {runs.wrong} wrong, {runs.stars:.1f} stars in the mean"
    return f"{name}: {solved}; NEES {runs.nees:.3f} (3 for a correct covariance)"


def _rms_note(runs: FieldRuns) -> str:
    return "; rms about x, y, z " + ", ".join(f"{value:.2g}" for value in runs.rms_rad) + " rad"


def _attitude_rows(claims: dict[str, Claim], published: Published, dual: FieldRuns) -> list[ClaimRow]:
    methods = (("two fields", dual.rms_rad, "rms error"), ("two fields, closed form", dual.predicted_rad, "1-sigma"))
    return [
        claim_row(claims[f"attitude about {axis}"], published, method, float(value), statistic=statistic)
        for method, values, statistic in methods
        for axis, value in zip(AXES, values, strict=True)
        if f"attitude about {axis}" in claims
    ]


def _single_rows(claims: dict[str, Claim], published: Published, single: FieldRuns) -> list[ClaimRow]:
    rows = [
        _plain_row(f"attitude about {axis}", "one field", float(error), "rad", "rms error", f"{single.stars:.1f} stars")
        for axis, error in zip(AXES, single.rms_rad, strict=True)
    ]
    across = float(math.sqrt(0.5 * (single.rms_rad[0] ** 2 + single.rms_rad[1] ** 2)))
    roll = float(single.rms_rad[2])
    if "single-field pitch and yaw" in claims:
        rows.append(claim_row(claims["single-field pitch and yaw"], published, "one field", across))
    for quantity, value in (("single-field roll over pitch and yaw", roll / across), ("single-field roll", roll)):
        if quantity in claims:  # the patent says that it is so bad: at least the figure
            claim = claims[quantity]
            rows.append(replace(claim_row(claim, published, "one field", value), met=value >= claim.value_si))
    return rows


def _identification_rows(
    sensor: StarSensor, claims: dict[str, Claim], published: Published, dual: FieldRuns, runs: int, seed: int
) -> list[ClaimRow]:
    rows = []
    claim = claims.get("misidentification")
    if claim is not None:
        bound = 10.0**dual.worst_log10_false_alarm
        rows.append(claim_row(claim, published, OURS, bound, statistic="largest bound of a frame accepted"))
        chance = spurious_quadruples(sensor, runs, seed)
        rows.append(
            claim_row(
                claim, published, PATENT, chance, condition="four false spots, tolerance four sigma", statistic="mean"
            )
        )
    wrong = "wrong attitudes"
    rows.append(_plain_row(wrong, OURS, dual.wrong / dual.frames, "probability", "share", "3 false spots, 5 % missing"))
    conditions = [SkyConditions(false_spots=false, missing=0.03) for false in FALSE_SPOTS]
    every_rate = identification_rates(sensor, conditions, max(20, runs // 5), seed)
    for false, rates in zip(FALSE_SPOTS, every_rate, strict=True):
        where = f"{false} false spots, 3 % missing"
        for method, rate in zip((OURS, PATENT, LITERAL), rates, strict=True):
            rows.append(_plain_row("frames solved", method, rate, "ratio", "share", where))
    return sorted(rows, key=lambda row: (OURS, PATENT, LITERAL).index(row.method))


def _formula_rows(
    sensor: StarSensor, claims: dict[str, Claim], published: Published, single: FieldRuns, runs: int, seed: int
) -> list[ClaimRow]:
    width = 2.0 * SkyConditions().field_radius_rad
    readings = patent_roll_readings(single.stars, width, single.sigma_rad)
    angle = cross_angle_error(sensor, width, 20 * runs, seed)
    ratio = detector_use(sensor, width, runs, seed)
    use = claims["detector use"]
    expected, reason = published.expected(use, "as printed", 0.0)
    return [
        *(
            claim_row(claims["roll formula"], published, reading, abs(sigma / float(single.rms_rad[2]) - 1.0))
            for reading, sigma in readings.items()
        ),
        claim_row(claims["cross-field angle"], published, "as printed", angle),
        ClaimRow(
            use.quantity,
            "as printed",
            use.condition,
            use.value,
            ratio,
            use.unit,
            use.statistic,
            ratio >= use.value,  # more is better here
            expected,
            reason,
        ),
    ]


def _detector_rows(
    sensor: StarSensor, claims: dict[str, Claim], published: Published, runs: int, seed: int
) -> list[ClaimRow]:
    """What the patent says of pixels, touching spots and baffles."""
    both, one, touch = occupancy(sensor, max(50, runs // 5), seed)
    stray = stray_over_star(sensor, Exposure(), BAFFLE, SkyConditions().faintest_mag)
    figures = (
        ("detector occupancy", "two fields", both),
        ("detector occupancy", "one field of the same lens", one),
        ("spots that touch", "two fields", touch),
        ("stray light under a star", "baffles of 1e-9", stray),
        ("stray light under a star", "baffles of 1e-8", 10.0 * stray),
    )
    return [claim_row(claims[name], published, method, value) for name, method, value in figures if name in claims]


def _plain_row(quantity: str, method: str, measured: float, unit: str, statistic: str, condition: str) -> ClaimRow:
    """A figure for which the patent claims nothing."""
    return ClaimRow(quantity, method, condition, math.nan, measured, unit, statistic, True, "met", "no claim")
