"""The error budget of a three-beacon design, by range: what each imperfection costs one fix and the settled filter.

Noise of spots and attitude is new in every image; everything else lasts, and no filter averages it. The attitude is an
error of the settled `spots` filter, which takes it as given; a fix tells it from its own spots. Its noise (`noise_deg`)
is a line of its own: by how much it raises the settled filter's variance. Where that is much, near the target, the
filter weighs what lasts otherwise than here, and reports more. Lines in brackets are what would come on top, or
instead, if something were done otherwise: they are not in the total.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.accuracy.field import FieldLimit, field_limits, saturation_range_m
from relnav.accuracy.sensitivity import Sensitivity, fix_by_spots, sensitivity, settled
from relnav.accuracy.single_shot import true_spots
from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.spherical import position_from_angles
from relnav.mission import Model
from relnav.navigation.observation.measurement_matrices import field_errors
from relnav.sensors.three_beacon.measure import measure

RANGES_M = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 6.5, 7.0, 8.0, 9.0, 10.0)
QUANTITIES = (("range", "m", 1.0), ("azimuth", "deg", math.degrees(1.0)), ("elevation", "deg", math.degrees(1.0)))
OFF_AXIS_DEG = (5.0, -3.0)
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
PERIOD_S = 0.1
"""Of images, for a model without a time code."""


@dataclass(frozen=True)
class BudgetLine:
    """One imperfection at one range: 1-sigma of (range m, azimuth rad, elevation rad), of a fix and settled."""

    name: str
    counts: bool
    single: Vector
    settled: Vector


@dataclass(frozen=True)
class BudgetPlace:
    """Everything at one range on the docking axis; `total`s are root sums of squares of the lines that count."""

    range_m: float
    visible: str
    spot_noise_m: Vector
    lines: tuple[BudgetLine, ...]
    bound: Vector

    def total(self, which: str) -> Vector:
        """1-sigma of (range m, azimuth rad, elevation rad), which = "single" or "settled"."""
        parts = np.array([getattr(line, which) for line in self.lines if line.counts])
        total: Vector = np.sqrt((parts**2).sum(axis=0))
        return total


@dataclass(frozen=True)
class Budget:
    """The budget of one model."""

    model: str
    period_s: float
    places: tuple[BudgetPlace, ...]
    field: tuple[FieldLimit, ...]
    saturation_m: float

    def to_dict(self) -> dict[str, Any]:
        """As plain values, angles in degrees."""

        def values(v: Vector) -> dict[str, float]:
            return {f"{name}_{unit}": float(x * scale) for (name, unit, scale), x in zip(QUANTITIES, v, strict=True)}

        return {
            "model": self.model,
            "period_s": self.period_s,
            "saturation_range_m": self.saturation_m,
            "field": [limit.to_dict() for limit in self.field],
            "places": [
                {
                    "range_m": place.range_m,
                    "visible": place.visible,
                    "spot_noise_um": (place.spot_noise_m * 1e6).tolist(),
                    "single_total": values(place.total("single")),
                    "settled_total": values(place.total("settled")),
                    "settled_noise_analytic": values(place.bound),
                    "lines": [
                        {
                            "name": line.name,
                            "counts": line.counts,
                            "single": values(line.single),
                            "settled": values(line.settled),
                        }
                        for line in place.lines
                    ],
                }
                for place in self.places
            ],
        }

    def lines(self) -> list[str]:
        """For a reader."""
        return _table(self)

    def change_lines(self, before: "Budget", change: str) -> list[str]:
        """What a change bought, for a reader: totals of the design before it and of this one."""
        out = [f"what {change} buys: totals before -> after"]
        for which, title in (("single", "one fix"), ("settled", "settled filter")):
            for k, (name, unit, scale) in enumerate(QUANTITIES):
                cells = []
                for one, two in zip(before.places, self.places, strict=True):
                    a, b = one.total(which)[k] * scale, two.total(which)[k] * scale
                    if not (math.isnan(a) or math.isnan(b)):
                        cells.append(f"{one.range_m:g} m {a:.4f} -> {b:.4f} (x {b / a:.2f})")
                out.append(f"  {title}, {name}, {unit}: " + "; ".join(cells[::2]))
        return out + ["  before: " + line for line in _field_lines(before)]


def budget_of(model: Model, ranges_m: tuple[float, ...] = RANGES_M) -> Budget:
    """The error budget of a model by range, on the docking axis.

    Raises
    ------
    ValueError
        If the model states no tolerances.
    """
    if model.tolerances is None:
        raise ValueError(
            f"{model.path or model.name}: a budget needs the section [tolerances]; three_beacon_psd shows its keys"
        )
    slots = len(model.beacons_lvlh_m) + (model.pulses is not None and model.pulses.dark_slot)
    period = PERIOD_S if model.pulses is None else slots * model.pulses.slot_s
    places = tuple(_place(model, range_m, period) for range_m in ranges_m)
    return Budget(model.name, period, places, field_limits(model), saturation_range_m(model))


def _place(model: Model, range_m: float, period_s: float) -> BudgetPlace:
    at = sensitivity(model, np.array([range_m, 0.0, 0.0]))
    fix, filtered = fix_by_spots(model, at), settled(model, at, period_s)
    sigma = at.sigma_m.ravel()
    steady = dataclasses.replace(model, attitude=dataclasses.replace(model.attitude, noise_rad=0.0))
    spots_alone = settled(steady, at, period_s).covariance
    lines = [
        BudgetLine("spot noise", True, _sigma(fix * np.where(np.isnan(sigma), 0.0, sigma)), _diagonal(spots_alone)),
        BudgetLine(
            "attitude noise",
            True,
            _sigma(fix @ (at.by_camera_turn * model.attitude.noise_rad)),
            np.sqrt(np.maximum(0.0, np.diag(filtered.covariance - spots_alone))),
        ),
        *(
            BudgetLine(name, counts, _sigma(fix @ spots), _sigma(filtered.by_bias @ spots))
            for name, counts, spots in _lasting(model, at)
        ),
        _perspective(model, range_m),
    ]
    names = "".join(name for name, seen in zip(LETTERS, at.visible, strict=False) if seen)
    return BudgetPlace(range_m, names, at.sigma_m.mean(axis=1), tuple(lines), _diagonal(filtered.bound))


def _lasting(model: Model, at: Sensitivity) -> list[tuple[str, bool, Matrix]]:
    """Lasting errors of the spots: name, whether it counts, and columns (2 n, k) of independent 1-sigma errors."""
    t = model.tolerances
    assert t is not None
    raw = t.distortion_limit_m / math.sqrt(3.0)
    calibrated = model.calibration is not None
    box = np.zeros(2), 0.5 * np.array(model.sensor.detector_size_m)
    if model.calibration is not None:
        box = np.array(model.calibration.center_m), np.array(model.calibration.half_width_m)
    left = field_errors(at.spots_m, *box, at.lasting_m if calibrated else np.full(at.visible.shape, 10e-6 / 3.0))
    turn = -cross_matrix(model.sensor.beacons_dock_m).reshape(-1, 3)  # theta x B
    unseen = np.where(np.repeat(at.visible, 2), 1.0, 0.0)[:, None]
    return [
        ("distortion, not calibrated", not calibrated, raw * unseen * np.eye(len(unseen))),
        ("distortion left by calibration", calibrated, unseen * left),
        (
            "focal length",
            True,
            unseen * (at.by_focal_length * model.sensor.focal_length_m * t.focal_length_relative_sigma)[:, None],
        ),
        ("beacon placement", True, unseen * at.by_beacons * t.beacon_placement_sigma_m),
        ("beacon mounting", True, unseen * (at.by_beacons @ turn) * t.beacon_mounting_sigma_rad),
        ("camera mounting", True, unseen * at.by_camera_turn * t.camera_mounting_sigma_rad),
        ("chaser attitude", True, unseen * at.by_camera_turn * model.attitude.sigma_rad),
        ("slots taken as simultaneous", False, unseen * _slot_errors(model, at)),
    ]


def _slot_errors(model: Model, at: Sensitivity) -> Matrix:
    """Errors (2 n, 5) of spots dated to the middle of the slots: motion along y and z, and turns about three axes."""
    t = model.tolerances
    assert t is not None
    if model.pulses is None:
        return np.zeros((len(at.by_position), 5))
    middle = 0.5 * (len(at.visible) - 1)
    late = np.repeat((np.arange(len(at.visible)) - middle) * model.pulses.slot_s, 2)[:, None]
    motion = at.by_position[:, 1:] * t.speed_m_s
    moved: Matrix = late * np.concatenate([motion, at.by_camera_turn * t.turn_rate_rad_s], axis=1)
    return moved


def _perspective(model: Model, range_m: float) -> BudgetLine:
    """Bias of the printed closed form under real optics, 5 deg off axis: counts for a model that uses it.

    The settled filter works on the spots themselves and has no part in it.
    """
    azimuth, elevation = np.radians(OFF_AXIS_DEG)
    p = np.empty(3)
    position_from_angles(np.array([range_m, azimuth, elevation]), p)
    wide = dataclasses.replace(model.sensor, detector_size_m=(1.0, 1.0))  # the field's edge is another matter
    got = measure(true_spots(model, p, "real")[:3], wide, projection="parallel")
    error: Vector = np.abs(got.value - np.array([range_m, azimuth, elevation]))
    return BudgetLine("printed form, 5 deg off axis", model.sensor.projection == "parallel", error, np.zeros(3))


def _sigma(columns: Matrix) -> Vector:
    """1-sigma (3,) of the sum of independent columns (3, k)."""
    return np.asarray(np.sqrt((columns**2).sum(axis=1)))


def _diagonal(covariance: Matrix) -> Vector:
    variances = np.diag(covariance)
    return np.asarray(np.sqrt(np.where(variances > 0.0, variances, np.nan)))  # rounding may leave one below zero


def _table(budget: Budget) -> list[str]:
    ranges = "".join(f"{place.range_m:9g}" for place in budget.places)
    out = [f"model {budget.model}: 1-sigma on the docking axis, by range; brackets: not in the total"]
    out.append(f"{'range, m':<34}{ranges}")
    out.append(f"{'beacons on the detector':<34}" + "".join(f"{place.visible or '-':>9}" for place in budget.places))
    for i, name in enumerate(LETTERS[: len(budget.places[0].spot_noise_m)]):
        cells = "".join(f"{place.spot_noise_m[i] * 1e6:9.2f}" for place in budget.places)
        out.append(f"{f'spot noise of {name}, um':<34}{cells}")
    for which, title in (("single", "one fix"), ("settled", f"settled filter, a cycle every {budget.period_s:g} s")):
        for k, (quantity, unit, scale) in enumerate(QUANTITIES):
            out.append(f"{title}: {quantity}, {unit}")
            out.extend(_rows(budget, which, k, scale))
            out.append(_row("total", [place.total(which)[k] * scale for place in budget.places]))
            if which == "settled":
                out.append(_row("spot noise alone, closed form", [place.bound[k] * scale for place in budget.places]))
    out.append(
        "chaser attitude: settled `spots` take it as given; one fix does not, nor does a settled filter of fixes"
    )
    return out + _field_lines(budget)


def _rows(budget: Budget, which: str, k: int, scale: float) -> list[str]:
    out = []
    for number, line in enumerate(budget.places[0].lines):
        name = line.name if line.counts else f"({line.name})"
        out.append(_row(name, [getattr(place.lines[number], which)[k] * scale for place in budget.places]))
    return out


def _row(name: str, values: list[float]) -> str:
    return f"  {name:<32}" + "".join(f"{'-':>9}" if math.isnan(v) else f"{v:9.4f}" for v in values)


def _field_lines(budget: Budget) -> list[str]:
    out = []
    for law, title in (("held", "camera held in lvlh_ccsds"), ("tracking", "camera turned to the target")):
        cells = [
            f"{limit.azimuth_deg:g} deg off axis "
            + ("never" if math.isinf(limit.triangle_m) else f"{limit.triangle_m:.2f} m")
            for limit in budget.field
            if limit.law == law
        ]
        out.append(f"A and B both in view down to, {title}: " + ", ".join(cells))
    if not math.isnan(budget.saturation_m):
        out.append(f"a beacon saturates the detector inside {budget.saturation_m:.2f} m")
    return out
