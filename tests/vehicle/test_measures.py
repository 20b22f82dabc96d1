"""What the `measure` of the five sensors returns, or the spots that it takes, is what the vehicle's filter takes."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.geometry.rotation import dcm_from_quaternion, quaternion_from_dcm
from relnav.sensors.dual_field.solution import StarStatus, no_solution
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.navigator import VehicleNavigator


@pytest.fixture
def seen(short_run):
    """First observation of each sensor."""
    return {event.sensor: event for event in reversed(short_run.observations)}


def solution_with(dcm):
    """As `measure` returns it, 3 arcsec about each axis."""
    nothing = no_solution(StarStatus.NO_MATCH, "", 5)
    return dataclasses.replace(
        nothing, status=StarStatus.OK, dcm_cam_from_icrs=dcm, covariance=(1.5e-5) ** 2 * np.eye(3)
    )


def test_a_star_solution_is_its_quaternion_with_its_covariance(navigator, seen):
    """From spots by `relnav.dual_field.measure`; a frame without an attitude is one that was not seen."""
    tracker, model = navigator._filters.sensors["star"], relnav.load_model("dual_field_star")
    dcm, rng = dcm_from_quaternion(np.array(seen["star"].value)), np.random.default_rng(1)
    frame = StarFieldSimulator(model, SkyConditions()).frame(rng, dcm=dcm)
    solution = relnav.dual_field.measure(
        frame.spots_px, model, magnitude=frame.magnitude, velocity_km_s=frame.velocity_km_s
    )
    assert solution.ok
    taken, noise = tracker.taken(solution, None)
    other, given = tracker.taken(quaternion_from_dcm(solution.dcm_cam_from_icrs), solution.covariance)
    np.testing.assert_allclose(taken, other, atol=1e-12)
    np.testing.assert_array_equal(noise, given)
    nothing, _ = tracker.taken(no_solution(StarStatus.NO_MATCH, "none", 5), None)
    assert np.all(np.isnan(nothing))


@pytest.mark.parametrize("wrong", [[1.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
def test_what_is_no_attitude_is_refused_by_the_name_of_its_sensor(navigator, wrong):
    with pytest.raises(ValueError, match=r"star: a rotation quaternion .* has norm 1 within 1e-3"):
        navigator.observe("star", 1.0, wrong)


@pytest.mark.parametrize(
    ("section", "key"),
    [("sensor.star", "q_sensor_from_chaser"), ("chaser", "q_chaser_from_lvlh"), ("target", "q_target_from_lvlh")],
)
def test_a_vehicle_names_what_is_no_attitude(vehicle, section, key):
    wrong = {key: (0.0, 0.0, 0.0, 2.0)}
    if section.startswith("sensor"):
        change = {"sensor": {**vehicle.sensor, "star": dataclasses.replace(vehicle.sensor["star"], **wrong)}}
    else:
        change = {section: dataclasses.replace(getattr(vehicle, section), **wrong)}
    with pytest.raises(ValueError, match=f"{section}.{key}: a rotation quaternion .* has norm 1 within 1e-3"):
        dataclasses.replace(vehicle, **change)


def test_all_five_in_one_filter(vehicle):
    """Solutions instead of quaternions, sun directions, and the spots that `measure` of the lights takes."""
    run = simulate_rendezvous(vehicle, Rendezvous(final_m=29.5), seed=3)
    navigator, verdicts = VehicleNavigator(vehicle, monitor=False), {}
    for event in run.observations:
        value = event.value
        if event.sensor == "star":
            value = solution_with(dcm_from_quaternion(np.array(value)))
        verdicts.setdefault(event.sensor, []).append(navigator.observe(event.sensor, event.t_s, value).name)
    for name in ("camera", "psd", "star", "sun_aps", "sun_birefringent"):
        assert verdicts[name].count("REJECTED") < 0.2 * len(verdicts[name]), name
