"""Star spots of simulated pictures: found, none invented, and each as far off as its covariance says."""

import numpy as np
import pytest

import relnav
from relnav.sensors.dual_field.star_spots import picture_centre
from relnav.simulation.star_picture import Exposure, picture_of

SIZE = (400, 300)
GAIN = Exposure().electrons_per_count


def sky(rng, flux, radius_px, count=40, **exposure):
    """A picture of stars of one flux, none near another or the border, and their places from the centre."""
    places = []
    while len(places) < count:
        place = rng.uniform(-0.5, 0.5, 2) * (np.array(SIZE) - 40.0)
        if all(np.hypot(*(place - other)) > 22.0 for other in places):
            places.append(place)
    exposure = Exposure(**({"radius_px": radius_px, "hot_pixels": 0.0} | exposure))
    spots = np.array(places)
    return spots, picture_of(spots, np.full(count, float(flux)), SIZE, exposure, rng).astype(np.uint16)


def paired(found, spots):
    """Index of the found spot of each true one (-1: none within 2 px), and how many found are none of them."""
    distance = np.linalg.norm(found.spots_px[:, None] - spots[None], axis=-1)
    nearest = distance.argmin(axis=0)
    hit = distance[nearest, np.arange(len(spots))] < 2.0
    return np.where(hit, nearest, -1), len(found.spots_px) - len(set(nearest[hit].tolist()))


@pytest.mark.parametrize("radius_px", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("flux", [1500.0, 8000.0])
def test_found_with_honest_covariance(radius_px, flux):
    """Mean NEES/2 over 200 stars, 1-sigma 0.07: never above 1.25; not far below 1 unless sampling is what limits."""
    nees, false = [], 0
    for seed in range(5):
        spots, picture = sky(np.random.default_rng(seed), flux, radius_px)
        found = relnav.find_stars(picture, electrons_per_count=GAIN)
        pairs, others = paired(found, spots)
        assert np.all(pairs >= 0) or radius_px == 2.5
        false += others
        for place, k in zip(spots[pairs >= 0], pairs[pairs >= 0], strict=True):
            error = found.spots_px[k] - place
            nees.append(error @ np.linalg.solve(found.covariance_px2[k], error) / 2.0)
    assert false <= 3
    assert len(nees) >= 190
    assert (0.4 if radius_px == 0.5 else 0.75) < np.mean(nees) < 1.25


def test_sampling_error_is_what_the_notes_say():
    """A bright narrow star without noise: rms over the phase in a pixel, beside the first harmonic's."""
    radius, rms = 0.45, []
    pixel = np.sqrt(radius**2 + 1.0 / 12.0)  # a Gaussian over a pixel is as wide as this
    m = 1.0 / (1.0 / pixel**2 + 1.0)
    expected = 4.0 * np.pi * m * np.exp(-2.0 * np.pi**2 * m) / (1.0 - m) / np.sqrt(2.0)
    for phase in np.linspace(-0.45, 0.45, 10):
        spots = np.array([[phase, 0.0], [60.0 + phase, 30.0]])
        exposure = Exposure(radius_px=radius, sky_counts=1.0, read_noise_counts=1.0, hot_pixels=0.0)
        picture = picture_of(spots, np.array([3e4, 3e4]), (200, 100), exposure, np.random.default_rng(0))
        found = relnav.find_stars(picture)
        rms += (found.spots_px[paired(found, spots)[0]] - spots)[:, 0].tolist()
    assert np.sqrt(np.mean(np.square(rms))) == pytest.approx(expected, rel=0.5)
    assert found.covariance_px2[0, 0, 0] == pytest.approx(expected**2, rel=0.5)


def test_flux_radius_and_order():
    rng = np.random.default_rng(2)
    spots = np.array([[-100.0, 0.3], [0.2, 50.0], [100.6, -40.0]])
    exposure = Exposure(radius_px=1.6, hot_pixels=0.0)
    picture = picture_of(spots, np.array([9e3, 3e4, 2e3]), SIZE, exposure, rng)
    found = relnav.find_stars(picture)
    np.testing.assert_allclose(found.spots_px, spots[[1, 0, 2]], atol=0.2)
    np.testing.assert_allclose(found.flux, [3e4, 9e3, 2e3], rtol=0.05)
    assert found.radius_px == pytest.approx(1.6, rel=0.08)
    np.testing.assert_allclose(found.in_picture_px, found.spots_px + np.array([199.5, 149.5]))
    assert len(relnav.find_stars(picture, most=2).flux) == 2


SCENES = {
    "hot pixels": lambda p, rng: np.where(rng.random(p.shape) < 2e-4, 60000, p),
    "gradient": lambda p, _: p + np.linspace(0, 3000, p.shape[1])[None, :],
    "8 bit": lambda p, _: np.clip(p // 20, 0, 255).astype(np.uint8),
    "floats below zero": lambda p, _: p * 1e-3 - 7.0,
    "12 bit in 16": lambda p, _: (p // 16 * 16).astype(np.uint16),
    "moon": lambda p, _: np.where(np.hypot(*(np.indices(p.shape) - [[[0]], [[0]]])) < 60, 65535, p).astype(np.uint16),
    "dark roof": lambda p, rng: np.where(np.indices(p.shape)[0] > 240, 20 + rng.integers(0, 9, p.shape), p),
    "dead pixels": lambda p, rng: np.where(rng.random(p.shape) < 3e-3, np.nan, p.astype(float)),
    "masked": lambda p, rng: np.ma.masked_array(p, mask=rng.random(p.shape) < 3e-3),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_pictures_have(name):
    """Nine of ten stars clear of it are found, to a tenth of a pixel, and at most two spots are none."""
    rng = np.random.default_rng(7)
    spots, picture = sky(rng, 9000.0, 1.3)
    found = relnav.find_stars(SCENES[name](picture, rng))
    place = spots + picture_centre(SIZE)
    clear = {"moon": np.hypot(*place.T) > 70.0, "dark roof": place[:, 1] < 232.0}.get(name, np.ones(len(spots), bool))
    pairs, false = paired(found, spots[clear])
    assert np.mean(pairs >= 0) >= 0.9
    assert false - np.sum(~clear) <= 2
    error = found.spots_px[pairs[pairs >= 0]] - spots[clear][pairs >= 0]
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_full_stars_keep_their_centre_and_say_so():
    spots, picture = sky(np.random.default_rng(3), 3e6, 1.3)
    found = relnav.find_stars(picture)
    pairs, false = paired(found, spots)
    assert false == 0
    assert np.all(pairs >= 0)
    assert found.saturated.all()
    error = found.spots_px[pairs] - spots
    assert np.sqrt(np.mean(error**2)) < np.sqrt(found.covariance_px2[0, 0, 0])


def test_two_stars_in_one_and_a_streak_are_flagged():
    rng = np.random.default_rng(4)
    spots = np.array([[-60.0, 0.0], [-57.0, 0.5], [60.0, 20.0], [0.0, -60.0], [30.0, -90.0]])
    picture = picture_of(spots, np.full(5, 2e4), SIZE, Exposure(radius_px=1.3, hot_pixels=0.0), rng)
    found = relnav.find_stars(picture)
    near = np.hypot(*(found.spots_px - spots[:2].mean(axis=0)).T) < 4.0
    assert near.any()
    assert found.blended[near].all()
    assert not found.blended[~near].any()


@pytest.mark.parametrize("length_px", [8.0, 12.0])
def test_a_streak_is_known_worse_along_it(length_px):
    """The camera turns during the exposure: mean NEES/2 of the middles of 300 streaks and more, 1-sigma 0.06."""
    nees = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        spots, _ = sky(rng, 1.0, 1.2)
        turn = rng.uniform(0.0, np.pi)
        trail = np.linspace(-0.5, 0.5, 40)[:, None] * length_px * np.array([np.cos(turn), np.sin(turn)])
        light = (spots[:, None] + trail).reshape(-1, 2)
        exposure = Exposure(radius_px=1.2, hot_pixels=0.0)
        picture = picture_of(light, np.full(len(light), 1000.0), SIZE, exposure, rng)
        found = relnav.find_stars(picture.astype(np.uint16), electrons_per_count=GAIN)
        distance = np.linalg.norm(found.spots_px[:, None] - spots[None], axis=-1)
        near = distance.min(axis=1) < 0.5 * length_px
        assert near.sum() >= 25
        assert found.blended[near].all()
        error = (found.spots_px - spots[distance.argmin(axis=1)])[near]
        scaled = np.linalg.solve(found.covariance_px2[near], error[..., None])[..., 0]
        nees += (error * scaled).sum(axis=1).tolist()
    assert 0.6 < np.mean(nees) / 2.0 < 1.25


@pytest.mark.parametrize(
    "picture",
    [
        np.full((60, 80), np.nan),
        np.full((60, 80), 7, dtype=np.uint8),
        np.zeros((8, 8)),
        np.full((50, 50), 255, dtype=np.uint8),
        np.full((50, 50), 1e300),
        (np.indices((200, 200)).sum(axis=0) % 2 * 255).astype(np.uint8),
        np.random.default_rng(1).integers(0, 255, (300, 300)),
    ],
    ids=["nan", "even", "smallest", "full", "beyond float32", "chessboard", "any counts"],
)
def test_no_star_where_there_is_none(picture):
    found = relnav.find_stars(picture)
    assert found.spots_px.shape == (0, 2)
    assert found.covariance_px2.shape == (0, 2, 2)
    assert np.isnan(found.radius_px)


def test_false_spots_of_noise_are_few():
    """Of two million pixels of Gaussian noise at 5 sigma: at most two."""
    assert len(relnav.find_stars(np.random.default_rng(5).normal(size=(1000, 2000))).flux) <= 2


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((np.zeros((5, 5, 3)),), "two axes"),
        ((np.zeros((4, 50)),), "two axes"),
        ((np.zeros((20, 20), dtype=complex),), "real numbers"),
        (("picture.png",), "real numbers"),
        ((np.zeros((20, 20)), "threshold_sigma", 0.0), "threshold_sigma is a number above zero"),
        ((np.zeros((20, 20)), "saturation", np.nan), "saturation is a number above zero"),
        ((np.zeros((20, 20)), "electrons_per_count", -1.0), "electrons_per_count is a number above zero"),
        ((np.zeros((20, 20)), "most", 0), "most is one star or more"),
    ],
)
def test_wrong_use(arguments, text):
    picture, *option = arguments
    with pytest.raises(ValueError, match=text):
        relnav.find_stars(picture, **({option[0]: option[1]} if option else {}))


def test_from_a_picture_to_an_attitude():
    """In one call each: the picture's spots are those that `measure` takes."""
    from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

    model = relnav.load_model("ground_camera")
    conditions = SkyConditions(faintest_mag=6.8, missing=0.0, false_spots=0, field_radius_rad=np.radians(7.1))
    rng = np.random.default_rng(6)
    frame = StarFieldSimulator(model, conditions).frame(rng)
    exposure = Exposure(zero_point=model.identification.magnitude_zero_point)
    picture = picture_of(frame.spots_px, exposure.flux(frame.magnitude), (1024, 768), exposure, rng)
    found = relnav.find_stars(picture)
    solution = relnav.dual_field.measure(found.spots_px, model, flux=found.flux)
    assert solution.ok
    error = solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T
    angles = np.array([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1]]) / 2.0
    assert np.all(np.abs(angles) < 4.0 * solution.sigma_rad)


@pytest.mark.parametrize(("radius_px", "block", "fewest", "most"), [(4.0, 1, 44, 48), (5.0, 1, 0, 4), (5.0, 2, 48, 48)])
def test_out_of_focus(radius_px, block, fewest, most):
    """Blobs wider than 4 px are no stars, until blocks of pixels are added up (docs/troubleshooting.md)."""
    rng = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(60.0, 1000.0, 120.0), np.arange(60.0, 740.0, 120.0))
    places = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-5.0, 5.0, (x.size, 2))
    column, row = np.arange(1024.0), np.arange(768.0)
    light = np.full((768, 1024), 100.0)
    for place, flux in zip(places, np.geomspace(4e3, 1e5, len(places)), strict=True):
        along, down = (
            np.exp(-0.5 * ((axis - c) / radius_px) ** 2) for axis, c in zip((column, row), place, strict=True)
        )
        light += flux * np.outer(down, along) / (2.0 * np.pi * radius_px**2)
    counts = rng.poisson(2.0 * light) / 2.0 + 3.0 * rng.normal(size=light.shape)
    counts = counts.reshape(768 // block, block, 1024 // block, block).sum(axis=(1, 3))
    found = block * relnav.find_stars(counts, electrons_per_count=2.0).in_picture_px + 0.5 * (block - 1)
    near = np.hypot(*(found[:, None] - places[None]).T) < 1.0
    assert fewest <= np.sum(near.any(axis=1)) <= most
