"""Pictures with stray light, defocused and overlapping spots, and a mirror of unequal halves: solved, none far off."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.dual_field_pictures import fly_pictures, occupancy, stray_counts, stray_over_star, touching
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_velocity
from relnav.simulation.star_picture import Exposure


@pytest.fixture(scope="module")
def sensor():
    return relnav.load_model("dual_field_star")


def test_pictures(sensor):
    rows = fly_pictures(sensor, 12, seed=3)
    for kind, row in rows.items():
        assert row["solved"] == row["pictures"] == 3, kind
        assert row["far"] == 0, kind
        assert row["found"] >= 0.9 * row["stars"], kind


def test_stray_light_falls_off_from_the_side_it_comes_from(sensor):
    dark = Exposure(stray_counts=(100.0, 40.0)).dark((50, 30)) - Exposure().sky_counts
    assert dark.mean() == pytest.approx(140.0)
    assert dark[0, 0] > dark[0, -1] > dark[-1, -1]
    assert dark[0, 0] - dark[0, -1] == pytest.approx(200.0 * (1.0 - 1.0 / 50.0))
    # the sun, 22.5 mag weaker, over 2048 x 2048 px: 10^(0.4 (15 + 26.74 - 22.5)) / 2048^2
    assert stray_counts(sensor, Exposure(), 1e-9) == pytest.approx(11.8, abs=0.1)
    assert stray_over_star(sensor, Exposure(), 1e-9, 5.75) == pytest.approx(0.23, abs=0.01)


def test_occupancy_and_spots_that_touch(sensor):
    assert touching(np.array([[0.0, 0.0], [6.0, 3.0], [20.0, 0.0]])) == 2
    both, one, touch = occupancy(sensor, 200, 1)
    assert both == pytest.approx(26 * 49 / 2048**2, rel=0.2)
    assert both == pytest.approx(one, rel=0.3)
    assert 0.0 < touch < 0.03


@pytest.mark.parametrize("halves", [(0.7, 0.3), (0.3, 0.7)])
def test_unequal_halves(sensor, halves):
    """Told of them the sensor is solved, whichever field is the brighter; untold hardly ever, and never wrongly."""
    fold = dataclasses.replace(sensor.fold, transmission=halves[0], reflectance=halves[1])
    real, rng = dataclasses.replace(sensor, fold=fold), np.random.default_rng(4)
    simulator, told, untold = StarFieldSimulator(real, SkyConditions()), 0, 0
    for _ in range(60):
        velocity = random_velocity(rng)
        frame = simulator.frame(rng, velocity_km_s=velocity)
        for model in (real, sensor):
            arguments = {"magnitude": frame.magnitude, "velocity_km_s": velocity}
            solution = relnav.dual_field.measure(frame.spots_px, model, **arguments)
            if solution.ok:
                assert np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 3.0 - 1e-6
            told += model is real and solution.ok
            untold += model is sensor and solution.ok
    assert told >= 45
    assert untold <= 6


def test_shares_of_more_than_all_light_are_refused(sensor):
    with pytest.raises(ValueError, match="together 1 at most"):
        dataclasses.replace(sensor.fold, transmission=0.7, reflectance=0.4)
