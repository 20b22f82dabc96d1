"""The patent as written reaches its figures; the readings of it that do not are shown not to.

The patent is "Error compensation method for the APS sun sensor of a Mars rover" (Chinese patent, 2021).
"""

import numpy as np
import pytest

from relnav.sensors.aps_sun.patent import fit_patent, paraxial, patent_angles, patent_batch, stage_one_angles
from relnav.sensors.aps_sun.rays import project

NOISE_PX = 0.03


@pytest.fixture(scope="module")
def bench(model, unit, grid):
    """(grid spots, grid angles, test spots, noisy test spots, test angles): every whole degree, 4000 between; deg."""
    rng = np.random.default_rng(2)
    angles, test = grid(121), rng.uniform(-60.0, 60.0, (4000, 2))
    spots, seen = project(model, unit(angles)), project(model, unit(test))
    return (
        spots + NOISE_PX * rng.normal(size=spots.shape), angles,
        seen, seen + NOISE_PX * rng.normal(size=seen.shape), test,
    )  # fmt: skip


@pytest.fixture(scope="module")
def tables(bench):
    return fit_patent(bench[0], *np.radians(bench[1]).T)


def three(error):
    return 3.0 * np.sqrt(np.mean(error**2))


def test_its_three_figures(bench, tables):
    """Raw 5 deg or more, below 0.5 deg after stage one, 0.03 deg (3 sigma) after stage two."""
    _, _, seen, noisy, test = bench
    assert np.abs(np.degrees(stage_one_angles(tables, noisy)) - test).max() < 0.5
    assert three(np.degrees(patent_angles(tables, noisy)[0]) - test) <= 0.03
    assert three(np.degrees(patent_angles(tables, seen)[0]) - test) < 0.010  # without noise: its own error


def test_thinner_glass_reaches_its_better_figure(thin, unit, grid):
    """0.02 deg, the text's second figure: within 3 % at this noise, with noise of 0.005 px by far."""
    rng = np.random.default_rng(3)
    angles, test = grid(121), rng.uniform(-60.0, 60.0, (4000, 2))
    spots, seen = project(thin, unit(angles)), project(thin, unit(test))
    for noise, bound in ((0.03, 0.0206), (0.005, 0.008)):
        made = fit_patent(spots + noise * rng.normal(size=spots.shape), *np.radians(angles).T)
        out, _ = patent_angles(made, seen + noise * rng.normal(size=seen.shape))
        assert three(np.degrees(out) - test) < bound


def test_the_mechanical_h_of_the_text_fails(model, bench):
    """0.18 deg instead of 0.025: without a linear term the cubic leaves a cusp on the axis."""
    h_px = model.sensor.hole_height_m / model.sensor.pixel_pitch_m
    made = fit_patent(bench[0], *np.radians(bench[1]).T, h_px=h_px)
    error = np.degrees(patent_angles(made, bench[2])[0]) - bench[4]
    assert 0.1 < three(error) < 0.3
    assert np.abs(np.degrees(stage_one_angles(made, bench[2])) - bench[4]).max() > 0.5
    near = np.abs(bench[4]).max(axis=1) < 8.0
    assert three(error[near]) > three(error[~near])


def test_the_row_of_the_same_axis_fails(bench, tables):
    """As the tables' caption reads: 0.2 deg. Step 8 of the text takes the other axis."""
    before = np.degrees(stage_one_angles(tables, bench[2]))
    wrong = np.empty_like(before)
    for axis in range(2):
        row = np.clip(np.floor(before[:, axis] + 0.5).astype(int) + 60, 0, 120)
        correction = [np.polyval(tables.rows[axis, r], b) for r, b in zip(row, before[:, axis], strict=True)]
        wrong[:, axis] = before[:, axis] + correction
    assert three(wrong - bench[4]) > 0.1


def test_it_is_its_equations(bench, tables):
    """Eqs (2), (4), (7) and (10) written out once more in plain Python, for spots inside and outside."""
    some = np.vstack([bench[2][:50], [[150.0, 300.0], [512.0, 900.0]]])
    out, valid = patent_angles(tables, some)
    for k, (x, y) in enumerate(some):
        dx, dy = x - tables.x0_px, y - tables.y0_px
        r = np.sqrt(dx**2 + dy**2)
        (p0, p1, p2), (q0, q1, q2) = tables.radial
        x_c = x + p0 * dx * r + p1 * dx * r**2 + p2 * dx * r**3
        y_c = y + q0 * dy * r + q1 * dy * r**2 + q2 * dy * r**3
        alpha = np.degrees(np.arctan((x_c - tables.x0_px) / tables.h_px))
        beta = np.degrees(np.arctan((y_c - tables.y0_px) / tables.h_px))
        m, n = (min(max(int(np.floor(v + 0.5)), -60), 60) for v in (beta, alpha))
        expected = alpha + np.polyval(tables.rows[0, m + 60], alpha), beta + np.polyval(tables.rows[1, n + 60], beta)
        np.testing.assert_allclose(np.degrees(out[k]), expected, rtol=1e-11)
        assert valid[k] == (np.abs(expected).max() <= 61.0)
    assert valid[:50].all()
    assert not valid[50:].any()


def test_rounding_leaves_steps_that_interpolation_removes(tables):
    """A walk along beta: steps where the row changes, none with interpolated rows."""
    y = np.linspace(260.0, 760.0, 40_001)
    walk = np.column_stack([np.full_like(y, 270.0), y])
    steps = {}
    for rows in ("round", "interpolate"):
        alpha = np.degrees(patent_angles(tables, walk, rows=rows)[0][:, 0])
        change = np.diff(alpha)
        steps[rows] = np.abs(change - np.median(change)).max()
    assert 0.003 < steps["round"] < 0.05
    assert steps["interpolate"] < 0.001


def test_interpolated_rows_are_no_worse(bench, tables):
    errors = [
        three(np.degrees(patent_angles(tables, bench[2], rows=rows)[0]) - bench[4]) for rows in ("round", "interpolate")
    ]
    assert errors[1] < errors[0]


def test_beyond_the_field_it_keeps_the_last_row_and_says_so(model, unit, tables):
    test = np.array([[60.9, 0.0], [62.0, 0.0], [70.0, 60.0], [-65.0, 10.0]])
    out, valid = patent_angles(tables, project(model, unit(test)))
    assert np.isfinite(out).all()
    np.testing.assert_array_equal(valid, [True, False, False, False])
    assert np.abs(np.degrees(out[0]) - test[0]).max() < 0.1


def test_gimbal_angles_taken_for_projection_angles_are_a_misfit(model):
    """At (40, 40) deg the two differ by 6 deg; the tables then leave more than a degree between their nodes."""
    from relnav.geometry.projection_angles import direction_from_gimbal

    along = np.radians(np.arange(-40.0, 41.0))
    outer, inner = (part.ravel() for part in np.meshgrid(along, along, indexing="ij"))
    spots = project(model, direction_from_gimbal(outer, inner))
    made = fit_patent(spots, inner, outer)
    t = np.tan(np.radians([[39.6, 39.6]]))
    s = np.array([*t[0], 1.0]) / np.sqrt(1.0 + np.sum(t**2))
    out = np.degrees(patent_angles(made, project(model, s)[None])[0][0])
    assert np.abs(out - 39.6).max() > 3.0


def test_the_order_of_the_points_does_not_matter(bench, tables):
    shuffled = np.random.default_rng(1).permutation(len(bench[0]))
    made = fit_patent(bench[0][shuffled], *np.radians(bench[1][shuffled]).T)
    np.testing.assert_array_equal(made.rows, tables.rows)
    np.testing.assert_array_equal(made.radial, tables.radial)


def test_zero_and_height_come_from_the_grid(aligned, unit, grid):
    angles = grid(121)
    zero, h = paraxial(project(aligned, unit(angles)), np.tan(np.radians(angles)))
    np.testing.assert_allclose(zero, aligned.sensor.zero_spot_px, atol=1e-9)
    assert h * aligned.sensor.pixel_pitch_m == pytest.approx(aligned.sensor.paraxial_height_m, rel=1e-3)


def test_seven_is_the_right_degree(bench):
    errors = {}
    for degree in (3, 5, 7):
        made = fit_patent(bench[0], *np.radians(bench[1]).T, degree=degree)
        errors[degree] = three(np.degrees(patent_angles(made, bench[2])[0]) - bench[4])
    assert errors[3] > 2.0 * errors[5] > 2.0 * errors[7]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda xy, a: (xy[:-1], a[:-1]), r"lacks 1 of 14641 \(alpha, beta\) deg: \(60, 60\)"),
        (lambda xy, a: (xy[10:], a[10:]), r"lacks 10 of 14641 .*\(-60, -60\), .*, \.\.\."),
        (lambda xy, a: (np.vstack([xy, xy[:1]]), np.vstack([a, a[:1]])), r"repeats 1 of 14641 .*\(-60, -60\)"),
        (lambda xy, a: (xy, a + 0.5), "whole degrees"),
    ],
)
def test_an_incomplete_grid_is_refused(bench, change, text):
    spots, angles = change(bench[0], bench[1])
    with pytest.raises(ValueError, match=text):
        fit_patent(spots, *np.radians(angles).T)


def test_a_spot_that_is_none(tables):
    out, valid = patent_angles(tables, np.array([[np.nan, 500.0], [np.inf, 500.0], [500.0, 500.0]]))
    assert np.isnan(out[0]).all()
    np.testing.assert_array_equal(valid, [False, False, True])


def test_compiled_and_plain_are_the_same(bench, tables):
    plain = getattr(patent_batch, "py_func", patent_batch)
    for interpolate in (False, True):
        outs = []
        for run in (patent_batch, plain):
            out = np.empty((200, 2))
            run(
                bench[2][:200].copy(), tables.x0_px, tables.y0_px, tables.h_px, tables.radial, tables.rows,
                tables.limit_deg, interpolate, out,
            )  # fmt: skip
            outs.append(out)
        np.testing.assert_allclose(outs[0], outs[1], rtol=1e-14)


def test_wrong_use(tables):
    with pytest.raises(ValueError, match='rows must be "round" or "interpolate"'):
        patent_angles(tables, np.zeros((1, 2)), rows="nearest")
    with pytest.raises(ValueError, match=r"shape \(N, 2\); got \(2,\)"):
        patent_angles(tables, np.zeros(2))
    with pytest.raises(ValueError, match="three points or more within 2 deg"):
        paraxial(np.zeros((2, 2)), np.zeros((2, 2)))
