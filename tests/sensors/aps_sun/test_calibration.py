"""Rays find the sensor from few points, a spline what rays leave, the table loses nothing, sigma is true."""

from dataclasses import replace

import numpy as np
import pytest

from relnav.accuracy.aps_sun import design
from relnav.sensors.aps_sun.calibration import angles_of_spots, as_built, calibrate, compile_table, spot_to_direction
from relnav.sensors.aps_sun.physical import (
    PARAMETERS,
    default_free,
    fit_physical,
    parameter_jacobian,
    parameter_values,
    with_parameters,
)
from relnav.sensors.aps_sun.rays import project, tangents_from_spots
from relnav.sensors.aps_sun.residual import choose_spline, fit_spline
from relnav.sensors.aps_sun.table import DirectionTable, direction_batch

NOISE_PX = 0.03


@pytest.fixture(scope="module")
def points(model, unit, grid):
    """points(side, noise, seed) -> noisy spots and directions of side x side points."""

    def of(side, noise=NOISE_PX, seed=0, sensor=model):
        s = unit(grid(side))
        spots = project(sensor, s)
        return spots + noise * np.random.default_rng(seed).normal(size=spots.shape), s

    return of


def test_without_noise_the_fit_finds_the_sensor(model, points):
    """From the design values, with glass tilt and wedge known: every fitted value comes back."""
    start = design(model)
    start = replace(
        start,
        sensor=replace(start.sensor, glass_tilt_rad=model.sensor.glass_tilt_rad),
        dome=replace(start.dome, wedge_m=model.dome.wedge_m),
    )
    fit = fit_physical(*points(7, noise=0.0), start)
    assert fit.rms_px < 1e-9
    np.testing.assert_allclose(fit.values, parameter_values(model, fit.free), rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize(("shift_px", "height", "glass"), [(100.0, 1.1, 1.0), (-200.0, 0.85, 1.3), (40.0, 1.2, 0.3)])
def test_it_is_found_from_far_off(model, points, shift_px, height, glass):
    """Zero spot 200 px, height 20 % and glass 70 % off lead to the same fit as the design does."""
    spots, s = points(7)
    near, start = fit_physical(spots, s, design(model)), design(model)
    x, y = start.sensor.zero_spot_px
    far = replace(
        start.sensor,
        zero_spot_px=(x + shift_px, y - shift_px),
        hole_height_m=height * start.sensor.hole_height_m,
        glass_thickness_m=glass * start.sensor.glass_thickness_m,
        glass_depth_m=0.2e-3,
    )
    fit = fit_physical(spots, s, replace(start, sensor=far))
    np.testing.assert_allclose(fit.values, near.values, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("glass_m", [0.0, 2e-3])
def test_a_sensor_without_a_dome(model, unit, grid, glass_m):
    """Without glass too it is a plain hole: a tilted detector is then found as a moved and misaligned one."""
    flat = {"glass_thickness_m": glass_m, "glass_tilt_rad": (0.0, 0.0)}
    bare = replace(without_dome(model), sensor=replace(model.sensor, **flat))
    spots = project(bare, unit(grid(7)))
    fit = fit_physical(spots, unit(grid(7)), without_dome(design(bare)))
    assert fit.free == default_free(bare)
    assert len(fit.free) == (9 if glass_m else 6)
    assert fit.rms_px < 1e-6
    if glass_m:
        np.testing.assert_allclose(fit.values, parameter_values(bare, fit.free), rtol=1e-6, atol=1e-9)


def test_parameter_jacobian(model, unit, grid, truth):
    s, names = unit(grid(3)), tuple(PARAMETERS)
    scale = np.array([PARAMETERS[name][3] for name in names])
    first = parameter_values(model, names)
    numeric = truth.derivative(
        lambda x: project(with_parameters(model, names, first + scale * x), s), np.zeros(16), 1e-2
    )
    np.testing.assert_allclose(
        parameter_jacobian(model, names, s).reshape(18, 16) * scale, numeric, rtol=1e-5, atol=1e-6
    )


def test_the_fits_covariance_is_true(model, points):
    """Mean NEES of 12 parameters over 30 fits lies in its 99.9 % band; truth without what the fit leaves out."""
    truth = replace(
        model,
        sensor=replace(model.sensor, glass_tilt_rad=(0.0, 0.0)),
        dome=replace(model.dome, wedge_m=(0.0, 0.0)),
    )
    names = default_free(truth)
    values, nees = parameter_values(truth, names), []
    for seed in range(30):
        fit = fit_physical(*points(7, seed=seed, sensor=truth), truth)
        error = fit.values - values
        nees.append(error @ np.linalg.solve(fit.covariance, error))
    assert 9.2 < np.mean(nees) < 15.2


def test_49_points_are_as_good_as_the_patents_14641(model, points, unit):
    """Systematic 3 sigma below 0.009 deg from 49 points, and the table gives what the rays give."""
    rng = np.random.default_rng(9)
    test = rng.uniform(-60.0, 60.0, (1000, 2))
    seen = project(model, unit(test))
    result = calibrate(*points(7), design(model))
    out = result.calibration.form.directions(seen)
    error = np.degrees(np.arctan(out[:, :2] / out[:, 2:])) - test
    assert result.calibration.method == "rays"
    assert 3.0 * np.sqrt(np.mean(error**2)) < 0.009
    exact = np.arctan(tangents_from_spots(result.fit.model, seen))
    assert np.degrees(np.abs(np.arctan(out[:, :2] / out[:, 2:]) - exact)).max() < 6e-4
    assert np.degrees(result.compile_loss_rad) < 6e-4
    assert result.fit.condition < 1000.0


def test_no_spline_where_rays_suffice(model, points):
    """Five draws of noise, none fools the cross-validation."""
    chosen = [calibrate(*points(25, seed=seed), design(model)).calibration.method for seed in range(5)]
    assert chosen == 5 * ["rays"]


def test_a_spline_follows_what_rays_cannot():
    """A wave of 0.3 px over the detector is recovered from 400 scattered points to a third of the noise."""
    rng = np.random.default_rng(3)
    spots = rng.uniform(200.0, 800.0, (400, 2))

    def wave(x):
        return 0.3 * np.stack([np.sin(x[:, 0] / 80.0), np.cos((x[:, 0] + x[:, 1]) / 110.0)], axis=1)

    choice = choose_spline(spots, wave(spots) + NOISE_PX * rng.normal(size=spots.shape), np.random.default_rng(0))
    inside = rng.uniform(230.0, 770.0, (500, 2))
    assert choice.spline is not None
    assert np.sqrt(np.mean((choice.spline.shift_px(inside) - wave(inside)) ** 2)) < NOISE_PX
    assert np.sqrt(choice.held_out_px2) < 0.05


def test_a_stiff_spline_is_a_plane():
    """The penalty leaves bilinear fields alone; beyond the data the edge's value holds."""
    rng = np.random.default_rng(4)
    spots = rng.uniform(0.0, 100.0, (60, 2))
    plane = spots @ np.array([[0.01, 0.002], [-0.003, 0.02]])
    spline = fit_spline(spots, plane, 1e-3)
    np.testing.assert_allclose(spline.shift_px(spots), plane, atol=0.02)
    far = spline.shift_px(np.array([[1e4, 50.0], [spots[:, 0].max(), 50.0]]))
    np.testing.assert_allclose(far[0], far[1], atol=1e-12)


def test_the_table_is_the_spline_through_its_nodes(model):
    table, _ = compile_table(model, None, cells=8)
    nodes = np.stack(np.meshgrid(table.x_px, table.y_px, indexing="ij"), axis=-1).reshape(-1, 2)
    out = table.directions(nodes - 1e-9 * np.sign(nodes - 512.0))  # the last node is an end of the table
    np.testing.assert_allclose(out[:, :2] / out[:, 2:], table.tangents.reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=1e-15)


def test_the_table_has_no_jumps(model):
    table, _ = compile_table(model, None)
    along = np.linspace(table.y_px[0], table.y_px[-1], 101)
    for x in table.x_px[1:-1]:
        left, right = (table.directions(np.column_stack([np.full(101, x + step), along])) for step in (-1e-9, 1e-9))
        assert np.degrees(np.abs(right - left).max()) < 1e-8


def test_compiled_and_plain_are_the_same(model):
    table, _ = compile_table(model, None, cells=8)
    spots = np.random.default_rng(1).uniform(200.0, 800.0, (300, 2))
    outs = []
    for run in (direction_batch, getattr(direction_batch, "py_func", direction_batch)):
        out = np.empty((300, 3))
        run(spots, table.grid, table.cells.reshape(64, 32), 8, 8, out)
        outs.append(out)
    np.testing.assert_allclose(outs[0], outs[1], rtol=1e-14)
    assert 0 < np.isnan(outs[0]).sum() < 300


def test_outside_the_table_is_nan(model):
    table, _ = compile_table(model, None, cells=8)
    x, y = table.x_px, table.y_px
    for spot in ([x[0] - 1e-6, y[3]], [x[-1] + 1e-6, y[3]], [x[3], y[0] - 1e-6], [x[3], y[-1] + 1e-6], [np.nan, y[3]]):
        assert np.isnan(table.directions(np.array([spot]))).all()
        assert np.isnan(table.tangents_with_slope(*spot)).all()
    assert np.isfinite(table.directions(np.array([[x[0], y[0]], [x[-1] - 1e-9, y[-1] - 1e-9]]))).all()


@pytest.mark.parametrize("spot", [(512.0, 509.0), (270.3, 700.9), (400.0, 300.0)])
def test_slope_of_the_table(model, spot, truth):
    calibration = as_built(model)
    s, slope = spot_to_direction(calibration, *spot)
    np.testing.assert_allclose(calibration.form.directions(np.array([spot]))[0], s, atol=1e-14)
    numeric = truth.derivative(lambda x: calibration.form.directions(x[None])[0], np.array(spot), 1.0)
    np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-9)


def test_the_patent_as_a_calibration(model, points, unit):
    """The patent's tables behind the same face: its own error, that of fresh directions, is in the covariance.

    The patent is "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
    """
    result = calibrate(*points(121), model, method="patent")
    assert result.calibration.method == "patent"
    fresh = unit(np.random.default_rng(1).uniform(-60.0, 60.0, (5000, 2)))  # its error there, as spots: without noise
    told = result.calibration.form, project(model, fresh)
    off = project(model, unit(np.degrees(angles_of_spots(*told)))) - told[1]
    assert result.calibration.calibration_noise_px == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.2)
    spots, s = points(5, noise=0.0)
    for spot, direction in zip(spots, s, strict=True):
        out, slope = spot_to_direction(result.calibration, *spot)
        assert np.degrees(np.abs(out - direction).max()) < 0.02
        _, exact = spot_to_direction(as_built(model), *spot)
        np.testing.assert_allclose(slope, exact, atol=0.03 * np.abs(exact).max())


def test_few_cells_are_worse_and_cells_are_doubled_as_needed(model):
    losses = [compile_table(model, None, cells=cells)[1] for cells in (4, 8, 16)]
    assert losses[0] > 5.0 * losses[1] > 25.0 * losses[2]
    assert isinstance(as_built(model).form, DirectionTable)
    assert len(as_built(model).form.x_px) == 17


def repeated(xy, s):
    """One point thirty times."""
    return np.repeat(xy[:1], 30, axis=0), np.repeat(s[:1], 30, axis=0)


def without_dome(model):
    return replace(model, dome=replace(model.dome, thickness_m=0.0))


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda m, xy, s: calibrate(xy, s, m, method="best"), "method is one of auto, rays, patent; got 'best'"),
        (lambda m, xy, s: fit_physical(xy, s, m, free=["height"]), "unknown parameter 'height'; known are hole_heig"),
        (lambda m, xy, s: fit_physical(xy[:5], s[:5], m), "12 parameters need more than 6 spots"),
        (lambda m, xy, s: fit_physical(xy, s[:-1], m), "with a direction"),
        (lambda m, xy, s: fit_physical(*repeated(xy, s), m), "these points cannot tell .* from .* whole field"),
        (
            lambda m, xy, s: fit_physical(xy, s, without_dome(m), free=["hole_height_m", "dome_centre_x_m"]),
            "no spot depends on dome_centre_x_m",
        ),
    ],
)
def test_wrong_use(model, points, call, text):
    with pytest.raises(ValueError, match=text):
        call(model, *points(5))
