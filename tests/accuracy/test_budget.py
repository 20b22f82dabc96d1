"""The error budget: every analytic figure against Monte Carlo, field limits against geometry, what a change buys."""

import dataclasses
import math

import numpy as np
import pytest

import relnav
from relnav.accuracy.budget import budget_of
from relnav.accuracy.campaign import noise_alone
from relnav.accuracy.field import field_limits, saturation_range_m
from relnav.accuracy.sensitivity import place_state, sensitivity, settled
from relnav.accuracy.statistics import error_statistics
from relnav.navigation.steady_state_filter import settled_filter
from relnav.sensors.three_beacon.calibration import Calibration
from relnav.sensors.three_beacon.fix import MEASURE_ROWS, measure_batch
from relnav.simulation.detector import project_beacons

FACING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])  # cam x = -y, y = +z, z = -x of the dock
RANGES = (4.5, 6.5, 9.0)
DRAWS = 20_000


@pytest.fixture(scope="module")
def model():
    """The attitude believed without error, as most tests here are of other lines."""
    return noise_alone(relnav.load_model("three_beacon_psd"), "spots")


@pytest.fixture(scope="module")
def budget(model):
    return budget_of(model, RANGES)


@pytest.fixture(scope="module")
def parallel_budget(model):
    return budget_of(
        dataclasses.replace(model, sensor=dataclasses.replace(model.sensor, projection="parallel")), (6.5,)
    )


def line(budget, range_m, name):
    place = next(place for place in budget.places if place.range_m == range_m)
    return next(entry for entry in place.lines if entry.name == name)


def fixes(model, spots):
    """Range, azimuth, elevation (n, 3) of the exact closed form, without edges."""
    n, s = len(spots), model.sensor
    rae, covariance, status = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(n, dtype=np.int64)
    measure_batch(
        np.ascontiguousarray(spots), s.focal_length_m, math.inf, math.inf, s.spot_noise_m, s.beacon_half_spacing_m,
        s.beacon_c_distance_m, 0, rae, covariance, status, np.zeros((MEASURE_ROWS, 6)),
    )  # fmt: skip
    assert (status == 0).mean() > 0.999
    return rae


def look(p, beacons, f, turn=None):
    """Central projection of beacons (n, 3, 3) from p (n, 3), camera turned by small vectors (n, 3)."""
    c = (beacons - p[:, None]) @ FACING.T
    if turn is not None:
        c = c - np.cross(turn[:, None], c)
    return f[:, None, None] * c[..., :2] / c[..., 2:]


def disturbed(name, model, truth, range_m, rng):
    """Spots (n, 3, 2) with one kind of error drawn, everything else perfect: written here, not from the product."""
    t, n = model.tolerances, DRAWS
    p = np.tile([range_m, 0.0, 0.0], (n, 1))
    beacons, f = np.tile(truth.beacons, (n, 1, 1)), np.full(n, truth.f)
    if name == "distortion, not calibrated":
        return look(p, beacons, f) + rng.uniform(-1, 1, (n, 3, 2)) * t.distortion_limit_m
    if name == "distortion left by calibration":
        spots = look(p, beacons, f)  # a smooth field: errors of 4 x 4 nodes, a third of the detector apart
        near = np.maximum(0.0, 1.0 - np.abs(1.5 * (spots[..., None] / 4e-3 + 1.0) - np.arange(4)))
        near /= np.linalg.norm(near, axis=-1, keepdims=True)
        nodes = rng.normal(size=(n, 4, 4, 2)) * 10e-6 / 3
        return spots + np.einsum("nbi,nbj,nijk->nbk", near[:, :, 0], near[:, :, 1], nodes)
    if name == "focal length":
        return look(p, beacons, f * (1 + t.focal_length_relative_sigma * rng.normal(size=n)))
    if name == "beacon placement":
        return look(p, beacons + rng.normal(size=(n, 3, 3)) * t.beacon_placement_sigma_m, f)
    if name == "beacon mounting":
        theta = rng.normal(size=(n, 1, 3)) * t.beacon_mounting_sigma_rad
        return look(p, beacons + np.cross(theta, beacons), f)
    if name == "camera mounting":
        return look(p, beacons, f, rng.normal(size=(n, 3)) * t.camera_mounting_sigma_rad)
    assert name == "slots taken as simultaneous"
    velocity = np.stack([np.zeros(n), *(rng.normal(size=(2, n)) * t.speed_m_s)], axis=1)
    rate = rng.normal(size=(n, 3)) * t.turn_rate_rad_s
    spots = np.empty((n, 3, 2))
    for i, late in enumerate((-1.0, 0.0, 1.0)):
        dt = late * model.pulses.slot_s
        spots[:, i] = look(p + velocity * dt, beacons, f, rate * dt)[:, i]
    return spots


@pytest.mark.parametrize("range_m", RANGES)
@pytest.mark.parametrize(
    "name",
    [
        "distortion, not calibrated", "distortion left by calibration", "focal length", "beacon placement",
        "beacon mounting", "camera mounting", "slots taken as simultaneous",
    ],
)  # fmt: skip
def test_lasting_errors_of_one_fix_agree_with_monte_carlo(model, budget, truth, name, range_m):
    """Within 5 %, the uncalibrated distortion included: the fix hardly bends."""
    error = fixes(model, disturbed(name, model, truth, range_m, np.random.default_rng(1))) - [range_m, 0.0, 0.0]
    measured, said = error.std(axis=0), line(budget, range_m, name).single
    floor = np.array([1e-5, 1e-6, 1e-6])
    np.testing.assert_allclose(np.where(measured < floor, 0, measured), np.where(said < floor, 0, said), rtol=0.05)


@pytest.mark.parametrize("range_m", RANGES)
def test_spot_noise_of_one_fix_agrees_with_monte_carlo(model, budget, truth, range_m):
    """Noise drawn at the level that the received power gives each beacon."""
    place = next(place for place in budget.places if place.range_m == range_m)
    clean = truth.central(np.array([range_m, 0.0, 0.0]), FACING)
    noise = np.random.default_rng(2).normal(size=(DRAWS, 3, 2)) * place.spot_noise_m[:, None]
    error = fixes(model, clean + noise) - [range_m, 0.0, 0.0]
    said = line(budget, range_m, "spot noise").single
    statistics = [error_statistics(error[:, k], np.full(DRAWS, said[k])) for k in range(3)]
    np.testing.assert_allclose([s.sigma for s in statistics], said, rtol=0.05)


def test_the_printed_forms_bias_counts_for_a_model_that_uses_it(budget, parallel_budget):
    """Design note: (5, -3) deg at 6.5 m is read as (5.564, -3.254)."""
    for report, counts in ((budget, False), (parallel_budget, True)):
        entry = line(report, 6.5, "printed form, 5 deg off axis")
        assert entry.counts is counts
        np.testing.assert_allclose(np.degrees(entry.single[1:]), [0.564, 0.254], atol=1e-3)


@pytest.fixture(scope="module")
def plain(model):
    """Constant spot noise and no control: what the filter itself believes."""
    return dataclasses.replace(model, detector=None, light=None)


def test_the_settled_filter_is_that_of_the_filters_own_rows(plain):
    for range_m in RANGES:
        p = np.array([range_m, 0.0, 0.0])
        ours = settled(plain, sensitivity(plain, p), 0.1).state.posterior
        np.testing.assert_allclose(
            ours, settled_filter(plain, p, 10.0, method="spots").posterior, rtol=1e-6, atol=1e-15
        )


def test_the_closed_form_of_the_settled_filter(plain):
    """Double integrator under white acceleration: agrees with the Riccati equation to 3 %, at ten images a second."""
    for range_m in RANGES:
        got = settled(plain, sensitivity(plain, np.array([range_m, 0.0, 0.0])), 0.1)
        np.testing.assert_allclose(np.sqrt(np.diag(got.bound)), np.sqrt(np.diag(got.covariance)), rtol=0.03)


@pytest.mark.parametrize("half_width_m", [4e-3, 3e-3], ids=["inside the box", "A and B outside it"])
@pytest.mark.parametrize("mode", ["lvlh_hold", "unknown"])
def test_a_calibrated_filter_at_rest_reports_what_the_budget_says(plain, truth, mode, half_width_m):
    """At 4.5 m, where A and B are 3.3 mm off the middle."""
    box = (half_width_m, half_width_m)
    calibration = Calibration(0, (0.0, 0.0), box, (0.0,), (0.0,), 3e-6, 0.05, 225, 1e-5)
    attitude = dataclasses.replace(plain.attitude, mode=mode)
    model = dataclasses.replace(plain, calibration=calibration, attitude=attitude, pulses=None)
    spots = truth.central(np.array([4.5, 0.0, 0.0]), FACING)
    times = np.arange(4000) * 0.1
    filtered = relnav.filter_epochs(model, times, np.tile(spots, (len(times), 1, 1)), method="spots")
    (place,) = budget_of(model, (4.5,)).places
    lines = {entry.name: entry.settled for entry in place.lines}
    said = np.hypot(lines["spot noise"], lines["distortion left by calibration"])
    np.testing.assert_allclose(filtered.docking_sigma[-1], said, rtol=0.01)


def test_lasting_errors_of_the_filter(plain, truth):
    """A constant error of each spot coordinate in turn through the filter itself, resting on V-bar (an equilibrium)."""
    range_m = 6.5
    said = settled(plain, sensitivity(plain, np.array([range_m, 0.0, 0.0])), 0.1).by_bias
    clean = truth.central(np.array([range_m, 0.0, 0.0]), FACING)
    t = np.arange(6000) * 0.1
    for column in range(6):
        spots = np.tile(clean, (len(t), 1, 1))
        spots.reshape(-1, 6)[:, column] += 5e-6
        track = relnav.filter_epochs(plain, t, spots, method="spots")
        error = track.docking[-1] - [range_m, 0.0, 0.0]
        np.testing.assert_allclose(error, said[:, column] * 5e-6, rtol=0.05, atol=5e-7)


def test_spot_noise_of_the_settled_filter_agrees_with_monte_carlo(plain, truth):
    """300 rests of 150 s at 6.5 m, disturbed by the white acceleration that the filter assumes; the last third counts.

    Each rest holds two or three independent errors of each coordinate: sigma is known to 2.5 %.
    """
    from scipy.linalg import expm

    range_m, runs, n = 6.5, 300, 1500
    dt, density = 0.1, plain.process_noise.acceleration_noise_density_m2_s3
    rng = np.random.default_rng(3)
    phi = expm(truth.hill_matrix(truth.n) * dt)
    q = density * np.block([[np.eye(3) * dt**3 / 3, np.eye(3) * dt**2 / 2], [np.eye(3) * dt**2 / 2, np.eye(3) * dt]])
    root = np.linalg.cholesky(q)
    x = np.tile([range_m, 0, 0, 0, 0, 0], (runs, 1)).astype(float)
    states = np.empty((n, runs, 6))
    for k in range(n):
        states[k] = x
        x = x @ phi.T + rng.normal(size=(runs, 6)) @ root.T
    t = np.arange(n) * dt
    errors = []
    for run in range(runs):
        p = states[:, run, :3]
        spots = look(p, np.tile(truth.beacons, (n, 1, 1)), np.full(n, truth.f))
        track = relnav.filter_epochs(
            plain, t, spots + rng.normal(size=spots.shape) * plain.sensor.spot_noise_m, method="spots"
        )
        r = np.linalg.norm(p, axis=1)
        true = np.stack([r, np.arctan2(p[:, 1], p[:, 0]), -np.arcsin(p[:, 2] / r)], axis=1)
        errors.append((track.docking - true)[1000:])
    measured = np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))
    said = np.sqrt(np.diag(settled(plain, sensitivity(plain, np.array([range_m, 0.0, 0.0])), dt).covariance))
    np.testing.assert_allclose(measured, said, rtol=0.05)


@pytest.mark.parametrize("noise_deg", [0.0, 0.02, 0.3])
def test_attitude_noise_of_the_settled_filter(plain, truth, noise_deg):
    """A filter at rest for ten minutes reports, of every axis, the root sum of squares of both lines of noise."""
    attitude = dataclasses.replace(plain.attitude, noise_rad=math.radians(noise_deg))
    model = dataclasses.replace(plain, attitude=attitude, pulses=None)
    for place in budget_of(model, (4.5, 9.0)).places:
        spots = truth.central(np.array([place.range_m, 0.0, 0.0]), FACING)
        t = np.arange(6000) * 0.1
        track = relnav.filter_epochs(model, t, np.tile(spots, (len(t), 1, 1)), method="spots")
        lines = {entry.name: entry.settled for entry in place.lines}
        said = np.hypot(lines["spot noise"], lines["attitude noise"])
        np.testing.assert_allclose(track.docking_sigma[-1], said, rtol=0.01)
        np.testing.assert_allclose(lines["spot noise"], place.bound, rtol=0.04)
        assert np.all(next(entry for entry in place.lines if entry.name == "attitude noise").single < 1e-3)


def test_field_limits(model):
    """Held: r = 12.5 (a + |y|) to first order, 3.75 m on axis, never both beyond 4.6 deg; turned: 3.75 m anyhow."""
    limits = {(limit.law, limit.azimuth_deg): limit for limit in field_limits(model)}
    assert limits["held", 0.0].triangle_m == pytest.approx(3.75, rel=1e-5)
    for azimuth_deg in (1.0, 2.0, 4.0):
        # the camera looks along -x: |y| + a = (4 / 50) r cos(azimuth)
        azimuth = math.radians(azimuth_deg)
        expected = 0.3 / (0.08 * math.cos(azimuth) - math.sin(azimuth))
        assert limits["held", azimuth_deg].triangle_m == pytest.approx(expected, rel=1e-4)
    assert math.isinf(limits["held", 5.0].triangle_m)
    for azimuth_deg in (0.0, 2.0, 5.0):
        assert limits["tracking", azimuth_deg].triangle_m == pytest.approx(3.75, rel=5e-3)
    assert limits["held", 0.0].beacon_c_m < 0.6


def test_saturation(model):
    """C in the middle of the detector: half of an axis' sum, and the background, on each electrode."""
    at = saturation_range_m(model)
    d, light = model.detector, model.light
    s = light.received_power_w(np.array(at), np.array(0.0), np.array(0.0)) * d.responsivity_a_w * 0.5
    background = light.background_power_w((8e-3, 8e-3), 0.05) * d.responsivity_a_w / 4.0
    assert 0.5 * s + background == pytest.approx(5.0 / d.feedback_resistance_ohm, rel=1e-6)
    assert math.isnan(saturation_range_m(dataclasses.replace(model, light=None)))


def test_a_longer_lens_buys_what_it_should(model):
    """Distortion dominates a design that is not calibrated: its share falls as 1/f, and the field by as much."""
    before, after = budget_of(model), budget_of(relnav.load_model("three_beacon_psd", {"focal_length_mm": 80}))
    one = next(place for place in before.places if place.range_m == 7.0).total("single")
    two = next(place for place in after.places if place.range_m == 7.0).total("single")
    np.testing.assert_allclose(two / one, 50.0 / 80.0, rtol=0.02)
    assert after.field[0].triangle_m == pytest.approx(6.0, rel=1e-5)
    text = "\n".join(after.change_lines(before, "focal_length_mm=80"))
    assert "what focal_length_mm=80 buys" in text
    assert "(x 0.63)" in text


@pytest.mark.parametrize("density", [1e-20, 1e-60, 1e-200])
def test_noise_that_is_lost_in_rounding_is_no_error(density):
    """Whether a filter settles is then the processor's; what one fix says does not depend on it."""
    model = relnav.load_model("three_beacon_psd", changes={"acceleration_noise_density_m2_s3": density})
    usual = budget_of(relnav.load_model("three_beacon_psd"), (5.0, 9.0))
    for place, wanted in zip(budget_of(model, (5.0, 9.0)).places, usual.places, strict=True):
        np.testing.assert_array_equal(place.total("single"), wanted.total("single"))


def test_a_calibration_takes_the_place_of_the_distortion(model, budget):
    from relnav.sensors.three_beacon.calibration import Calibration

    calibration = Calibration(0, (0.0, 0.0), (3e-3, 3e-3), (0.0,), (0.0,), 3e-6, 0.01, 225, 1e-5)
    calibrated = budget_of(dataclasses.replace(model, calibration=calibration), (6.5,))
    before = next(place for place in budget.places if place.range_m == 6.5)
    assert not line(calibrated, 6.5, "distortion, not calibrated").counts
    assert line(calibrated, 6.5, "distortion left by calibration").counts
    assert calibrated.places[0].total("settled")[0] < 0.05 * before.total("settled")[0]


def test_close_in_only_c_is_seen_and_nothing_is_invented(model):
    place = budget_of(model, (2.0,)).places[0]
    assert place.visible == "C"
    assert np.isnan(place.total("single")).all()
    assert np.isnan(place.total("settled")).all()


def test_a_model_without_tolerances(model):
    with pytest.raises(ValueError, match=r"a budget needs the section \[tolerances\]"):
        budget_of(dataclasses.replace(model, tolerances=None))


class WithTriads(relnav.three_beacon.ThreeBeaconSensor):
    """Small equilateral triads besides A, B, C: 0.06 m for the last two metres, 0.03 m for the last one."""

    @property
    def beacons_dock_m(self):
        triads = [[[0, a, 0], [0, -a, 0], [math.sqrt(3.0) * a, 0, 0]] for a in (0.06, 0.03)]
        return np.concatenate([super().beacons_dock_m, *triads])


def test_small_triads_carry_the_last_metres(model):
    """A, B are off inside 3.75 m, D, E inside 0.75 m, G, H inside 0.375 m; range is then known from what is left."""
    sensor = WithTriads(**vars(model.sensor))
    places = budget_of(dataclasses.replace(model, sensor=sensor), (0.7, 1.0, 2.0, 5.0)).places
    assert [place.visible for place in places] == ["CFGHI", "CDEFGHI", "CDEFGHI", "ABCDEFGHI"]
    settled_m = [place.lines[0].settled[0] for place in places]
    assert np.isfinite(settled_m).all()
    assert max(settled_m[:3]) < 0.001
    alone = budget_of(model, (5.0,)).places[0].lines[0].settled[0]
    assert settled_m[3] < 1.6 * alone  # a longer cycle for nine beacons, and little from the small ones far out
    assert np.isnan(places[1].total("single")).all()  # the closed form needs A, B and C


@pytest.mark.parametrize(
    ("sigma_deg", "noise_deg", "within"),
    [(0.0, 0.0, (1e-3, 0.05)), (0.15, 0.0, (2e-3, 0.06)), (0.15, 0.02, (0.03, 0.065))],
)
def test_the_filter_reports_what_the_budget_says(model, sigma_deg, noise_deg, within):
    """A chaser that holds its place for ten minutes: the filter's own sigma beside the settled budget's total.

    Two ways to one number: sensitivities carried from image to image, and the limit of the settled filter. The filter
    weighs spots by what the state cannot take up of lasting errors too, of the attitude most: at 4.5 m 6 % of an
    angle and 0.2 % of the range.
    """
    told = {"sigma_rad": math.radians(sigma_deg), "noise_rad": math.radians(noise_deg)}
    attitude = dataclasses.replace(model.attitude, **told)
    model = dataclasses.replace(model, attitude=attitude)
    calibration = Calibration(0, (0.0, 0.0), (3.46e-3, 3.46e-3), (0.0,), (0.0,), 2.4e-6, 0.0, 225, 1e-5)
    tolerances = dataclasses.replace(model.tolerances, considered=True)
    told = dataclasses.replace(model, calibration=calibration, tolerances=tolerances)
    places = budget_of(told, RANGES)
    t = np.arange(6000) * places.period_s
    for place in places.places:
        state = place_state(told, np.array([place.range_m, 0.0, 0.0]))
        spots = np.repeat(project_beacons(told, state[None]), len(t), axis=0)
        sigma = np.broadcast_to(place.spot_noise_m[:, None], spots.shape)
        solution = relnav.filter_epochs(told, t, spots, spot_sigma_m=sigma, method="spots")
        reported, expected = solution.docking_sigma[-1], place.total("settled")
        assert reported[0] == pytest.approx(expected[0], rel=within[0])
        lines = {entry.name: entry for entry in place.lines}
        turned = lines["chaser attitude"].settled[1:]  # nearly the angle itself: a little is told from A, B and C
        assert (turned <= attitude.sigma_rad).all()
        assert (turned >= (0.9 if noise_deg == 0.0 else 0.7) * attitude.sigma_rad).all()  # noise: told the more
        assert np.abs(lines["chaser attitude"].single).max() < 1e-9
        np.testing.assert_allclose(reported[1:], expected[1:], rtol=within[1])
        noise = place.lines[0].settled
        assert (expected > 2.0 * noise).all()


def test_a_beacon_behind_the_camera_counts_as_unseen(model):
    """At 1.5 m a beacon 2 m out is behind: a fix is worth what it is without it."""
    wide = dataclasses.replace(model.sensor, detector_size_m=(0.1, 0.1))
    more = dataclasses.replace(wide, extra_beacons_m=((2.0, 0.0, 0.0),))
    three, four = (budget_of(dataclasses.replace(model, sensor=s), (1.5,)).places[0] for s in (wide, more))
    assert three.visible == four.visible == "ABC"
    for name in ("spot noise", "focal length", "beacon placement", "beacon mounting", "camera mounting"):
        one, other = (next(entry for entry in place.lines if entry.name == name) for place in (three, four))
        np.testing.assert_allclose(other.single, one.single, rtol=1e-9, atol=1e-15)
        assert np.isfinite(other.settled).all()
