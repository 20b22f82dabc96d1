"""What the second field of a two-field sensor must show: two stars do, and chance stays below its bound."""

import dataclasses

import numpy as np

import relnav
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

REST = (0.0, 0.0, 0.0)


def test_two_stars_of_the_poorer_field_are_enough(mounted_sensor, error_rad):
    """Beside three false spots, with a fold off by its stated error; all but two stars of that field are hidden."""
    simulator, rng, solved = StarFieldSimulator(mounted_sensor, SkyConditions()), np.random.default_rng(12), 0
    for k in range(100):
        simulator.mount(rng)
        frame = simulator.frame(rng)
        shown = frame.field != k % 2
        shown[rng.choice(np.flatnonzero(~shown), 2, replace=False)] = True
        solution = relnav.dual_field.measure(
            frame.spots_px[shown], mounted_sensor, magnitude=frame.magnitude[shown], velocity_km_s=REST
        )
        solved += solution.ok
        if solution.ok:
            error = error_rad(solution, frame)
            assert error @ np.linalg.solve(solution.covariance, error) < 31.81, "beyond 5 sigma"
    assert solved >= 90


def test_a_second_field_by_chance_is_as_rare_as_stated(mounted_sensor):
    """A mirrored image is explained as the other field, so what is found in the second field is chance."""
    stated, frames, accepted = 1e-2, 2000, 0
    limits = dataclasses.replace(mounted_sensor.identification, false_alarm_probability=stated)
    sensor = dataclasses.replace(mounted_sensor, identification=limits)
    simulator, rng = StarFieldSimulator(sensor, SkyConditions()), np.random.default_rng(5)
    for _ in range(frames):
        frame = simulator.frame(rng)
        spots = frame.spots_px * (-1.0, 1.0)
        accepted += relnav.dual_field.measure(spots, sensor, magnitude=frame.magnitude, velocity_km_s=REST).ok
    assert 0 < accepted <= stated * frames
