"""Two sensors that look at the same lights have their places wrong by the same: one block of errors, counted once."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.rendezvous import fly, honesty
from relnav.accuracy.vehicle_budget import sources
from relnav.estimation.consistency import chi_square_interval
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import layout_of, places_of_lights
from relnav.vehicle.navigator import VehicleNavigator

RUNS = 24
FLIGHT = Rendezvous(start_m=5.5, final_m=4.0, fast_m_s=0.1, slow_m_s=0.1, as_believed=True)
SURVEY_M = 1e-3
"""So large that the places of the lights limit what is known of the port."""


def with_second_camera(vehicle, moved_m=0.0):
    """A second camera 0.3 m below the first, at the same markers; moved_m: they seem to be others, so far away."""
    camera = dataclasses.replace(vehicle.sensor["camera"], points_sigma_m=SURVEY_M)
    (x, y, z), (ahead, *aside) = camera.position_m, camera.pattern_position_m
    seen = {"first_s": 0.2, "position_m": (x, y, z + 0.3), "pattern_position_m": (ahead + moved_m, *aside)}
    below = dataclasses.replace(camera, **seen)
    others = {name: mounted for name, mounted in vehicle.sensor.items() if name not in {"camera", "psd"}}
    return dataclasses.replace(
        vehicle,
        sensor={"camera": camera, "below": below, **others},
        models={**vehicle.models, "below": vehicle.models["camera"]},
    )


@pytest.fixture(scope="module")
def two(slow):
    return with_second_camera(slow)


def test_common_lights_are_one_block(slow, two):
    names, count = layout_of(two).by_name, len(two.points_m("camera"))
    assert names["camera.points"].stop - names["camera.points"].start == 3 * count
    assert "below.points" not in names
    assert two.new_lights("below") == 0
    apart = with_second_camera(slow, moved_m=1e-3)
    assert layout_of(apart).size == layout_of(two).size + 3 * count


def test_the_covariance_counts_common_lights_once(slow, two):
    """With the same flights the filter that takes them for other lights is overconfident."""
    runs, apart = [simulate_rendezvous(two, FLIGHT, seed=70 + k) for k in range(RUNS)], with_second_camera(slow, 2e-6)
    points, misled = ([fly(run, (4.0,), believed=vehicle)[0] for run in runs] for vehicle in (two, apart))
    for names in ("port", "target_attitude"):
        ratio, dof = honesty(points, layout_of(two).by_name, names)
        lower, upper = chi_square_interval(dof, 0.9999)
        assert lower < ratio < upper
    assert honesty(misled, layout_of(apart).by_name, "target_attitude")[0] > upper


def test_a_light_more_is_its_own(two):
    """One sensor sees a light that the other does not, and its own lights in another order."""
    more = tuple(two.points_m("camera")[2] - two.sensor["below"].pattern_position_m)
    model = two.models["camera"]
    positions = model.markers.positions_m
    turned = dataclasses.replace(model.markers, positions_m=(*positions[1:], positions[0]))
    mixed = dataclasses.replace(
        two,
        sensor={
            **two.sensor,
            "below": dataclasses.replace(two.sensor["below"], extra_points_m=((0.0, 0.3, 0.1), more)),
        },
        models={**two.models, "below": dataclasses.replace(model, markers=turned)},
    )
    layout, n = layout_of(mixed), len(positions)
    camera, below = layout.by_name["camera.points"].start, layout.by_name["below.points"].start
    expected = [*range(camera + 3, camera + 3 * n, 3), camera, below, camera + 6]
    np.testing.assert_array_equal(places_of_lights(layout, mixed, "below"), expected)
    run = simulate_rendezvous(mixed, FLIGHT, seed=5)
    assert run.lasting["below.points"].shape == (3,)
    nav = VehicleNavigator(mixed)
    sensor, at = nav._filters.sensors["below"], nav._timeline.newest.estimates
    spots = np.zeros(2 * (n + 2))
    rows = sensor.rows(at, spots, np.eye(len(spots))).jacobian[0]
    for k, first in enumerate(expected):
        elsewhere = np.delete(np.arange(camera, below + 3), np.arange(first, first + 3) - camera)
        elsewhere = elsewhere[(elsewhere < camera + 3 * n) | (elsewhere >= below)]
        assert np.abs(rows[2 * k : 2 * k + 2, first : first + 3]).max() > 0.0
        assert (rows[2 * k : 2 * k + 2, elsewhere] == 0.0).all()


def test_common_lights_are_stated_alike(two):
    other = dataclasses.replace(two.sensor["below"], points_sigma_m=2e-4, points_role="considered")
    told = r"sensor\.below: lights of it are those of sensor\.camera.*1 mm \(estimated\) and 0\.2 mm \(considered\)"
    with pytest.raises(ValueError, match=told):
        dataclasses.replace(two, sensor={**two.sensor, "below": other})


def test_the_budget_has_one_line_for_common_lights(two):
    found = [source for source in sources(two) if source.name.endswith(" points")]
    assert [source.name for source in found] == ["camera points"]
    assert {found[0].halved.sensor[name].points_sigma_m for name in ("camera", "below")} == {SURVEY_M / 2.0}
    alone = [source.name for source in sources(relnav.load_model("rendezvous_demo")) if source.name.endswith(" points")]
    assert alone == ["camera points", "psd points"]
