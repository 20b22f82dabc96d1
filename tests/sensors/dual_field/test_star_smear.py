"""A camera that turns during the exposure smears all stars: the faint ones are flagged, and as far off as stated."""

import numpy as np
import pytest

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.sensors.dual_field.star_smear import pooled
from relnav.simulation.star_picture import Exposure, picture_of

SIZE, STEP = (768, 512), 64
EXPOSURE = Exposure(radius_px=1.2, sky_counts=20.0, read_noise_counts=3.0, hot_pixels=0.0)
FAINT, BRIGHT = 600.0, 15000.0
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def turned(rng, length_px):
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return length_px * np.array([np.cos(angle), np.sin(angle)])


def shift(length_px):
    return lambda spots, rng: np.tile(turned(rng, length_px), (len(spots), 1))


def roll(length_px, at_corner_px):
    """A shift, and a turn about the middle that smears the corners by so much."""
    rate = at_corner_px / (0.5 * np.hypot(*SIZE))
    return lambda spots, rng: turned(rng, length_px) + rate * spots @ QUARTER.T


def two_fields(spots, rng):
    """Every star is of one field or the other, whose turns look different."""
    one = turned(rng, 10.0)
    other = one @ np.array([[0.36, 0.93], [-0.93, 0.36]])
    return np.where(rng.random(len(spots))[:, None] < 0.5, one, other)


def scene(rng):
    """Stars on a grid, none near another, three in four of them faint: places and fluxes."""
    x, y = np.meshgrid(*(np.arange(STEP / 2, side, STEP) - 0.5 * (side - 1) for side in SIZE))
    spots = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-0.5, 0.5, (x.size, 2))
    return spots, np.where(rng.random(len(spots)) < 0.75, FAINT, BRIGHT)


def smeared(spots, flux, streaks, rng, parts=60):
    """Counts of stars that move evenly along their streaks (n, 2) px during the exposure."""
    light = (spots[:, None] + np.linspace(-0.5, 0.5, parts)[:, None] * streaks[:, None]).reshape(-1, 2)
    return picture_of(light, np.repeat(flux / parts, parts), SIZE, EXPOSURE, rng).astype(np.uint16)


def found_faint(picture, spots, flux, reach_px):
    """Which faint stars are found, NEES of each, and the spots of all."""
    found = relnav.find_stars(picture, electrons_per_count=EXPOSURE.electrons_per_count)
    distance = np.linalg.norm(found.spots_px[:, None] - spots[None], axis=-1)
    nearest, near = distance.argmin(axis=1), distance.min(axis=1) < reach_px
    near &= flux[nearest] == FAINT
    error = (found.spots_px - spots[nearest])[near]
    return nearest[near], np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_px2[near]), error), found


@pytest.mark.parametrize(
    ("motion", "reach_px"),
    [(shift(8.0), 4.0), (shift(12.0), 6.0), (shift(16.0), 8.0), (roll(0.0, 12.0), 6.0), (roll(6.0, 12.0), 8.0)],
    ids=["8 px", "12 px", "16 px", "roll", "roll and shift"],
)
def test_faint_stars_of_a_smeared_picture(motion, reach_px):
    """Mean NEES/2 of some 280 faint stars within its 99.9 % bounds; nearly all found, each once, every spot flagged."""
    nees, stars, twice = [], 0, 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        spots, flux = scene(rng)
        which, chi2, found = found_faint(smeared(spots, flux, motion(spots, rng), rng), spots, flux, reach_px)
        assert found.blended.all()
        nees += chi2.tolist()
        stars, twice = stars + int(np.sum(flux == FAINT)), twice + len(which) - len(set(which.tolist()))
    low, high = chi_square_interval(2 * len(nees), 0.999)
    assert low < np.mean(nees) / 2.0 < high
    assert len(nees) >= 0.95 * stars
    assert twice == 0


def test_two_fields_that_turn_differently():
    """No common smear: every spot is flagged, and NEES/2 of faint stars below 1.6."""
    nees = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        spots, flux = scene(rng)
        _, chi2, found = found_faint(smeared(spots, flux, two_fields(spots, rng), rng), spots, flux, 5.0)
        assert found.blended.all()
        nees += chi2.tolist()
    assert len(nees) >= 200
    assert np.mean(nees) / 2.0 < 1.6


def test_longer_than_any_window():
    """30 px: where along the streak its middle is, is in the covariance; NEES/2 of what is found below 1.1."""
    nees = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        spots, flux = scene(rng)
        flux *= 4.0
        picture = smeared(spots, flux, shift(30.0)(spots, rng), rng)
        found = relnav.find_stars(picture, electrons_per_count=EXPOSURE.electrons_per_count)
        distance = np.linalg.norm(found.spots_px[:, None] - spots[None], axis=-1)
        error = found.spots_px - spots[distance.argmin(axis=1)]
        nees += np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_px2), error)[
            distance.min(axis=1) < 15.0
        ].tolist()
    assert len(nees) >= 150
    assert np.mean(nees) / 2.0 < 1.1


def with_doubles(picture, spots, rng):
    """Every sixth star is two, all in one direction."""
    extra = picture_of(spots[::6] + np.array([3.0, 0.5]), np.full(len(spots[::6]), 9e3), SIZE, EXPOSURE, rng)
    return picture + extra


def with_columns(picture, _, rng):
    """Hot columns, brighter than most stars, between them."""
    hot = np.zeros(SIZE[0])
    hot[[128, 384, 640]] = rng.uniform(300.0, 3000.0, 3)
    return picture + hot


def with_trails(picture, _, rng):
    """A satellite's trail across the picture between the stars, and one along."""
    ends = np.linspace(-400.0, 400.0, 800)
    trail = np.concatenate([np.column_stack([ends, np.full(800, 0.5)]), np.column_stack([np.full(800, 0.5), ends])])
    return picture + picture_of(trail, np.full(len(trail), 900.0), SIZE, EXPOSURE, rng)


@pytest.mark.parametrize("spoiled", [with_doubles, with_columns, with_trails], ids=["doubles", "columns", "trails"])
def test_what_is_long_does_not_decide_for_the_stars(spoiled):
    """Round stars beside elongated things are not flagged, and their covariance is round."""
    rng = np.random.default_rng(3)
    spots, flux = scene(rng)
    picture = spoiled(smeared(spots, flux, np.zeros_like(spots), rng), spots, rng)
    found = relnav.find_stars(picture, electrons_per_count=EXPOSURE.electrons_per_count)
    single = spots[np.arange(len(spots)) % 6 > 0]
    distance = np.linalg.norm(found.spots_px[:, None] - single[None], axis=-1)
    near = distance.min(axis=1) < 1.0
    assert near.sum() >= 0.95 * len(single)
    assert not found.blended[near].any()
    values = np.linalg.eigvalsh(found.covariance_px2[near])
    assert np.all(values[:, 1] < 2.0 * values[:, 0])


def test_few_bright_stars_say_nothing_of_the_others():
    """Five long spots among faint round stars, whose moments are not known: nine of ten round ones are not flagged."""
    rng = np.random.default_rng(4)
    spots, flux = scene(rng)
    flux[:] = 170.0
    flux[::20] = BRIGHT
    streaks = np.where((flux == BRIGHT)[:, None], np.array([8.0, 3.0]), 0.0)
    found = relnav.find_stars(smeared(spots, flux, streaks, rng), electrons_per_count=EXPOSURE.electrons_per_count)
    assert len(found.flux) > 30
    assert found.blended.sum() < 5 + 0.1 * len(found.flux)


def test_peaks_of_one_streak_are_one_star():
    """Three streaks that break up into four peaks each are three stars; twelve streaks are enough."""
    shapes = np.tile(np.diag([9.0, 1.5]), (12, 1, 1))
    broken = np.array([[100.0 * k + 5.0 * part, 80.0 * k] for k in range(3) for part in range(4)])
    apart = np.array([[100.0 * (k % 4), 90.0 * (k // 4) + 7.0 * k] for k in range(12)])
    middle = np.array([200.0, 150.0])
    assert pooled(broken, shapes, broken, 1.0, middle, 1.2) is None
    smear = pooled(apart, shapes, apart, 1.0, middle, 1.2)
    assert smear is not None
    assert smear.alike
    assert abs(smear.shift) == pytest.approx(np.sqrt(7.5))
    assert smear.roll == pytest.approx(0.0, abs=1e-9)
