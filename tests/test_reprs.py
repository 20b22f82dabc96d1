"""What a console shows of a model, a navigator and an estimate: which it is, when, and how far to trust it."""

import copy
import dataclasses
import pickle

import numpy as np
import pytest

import relnav
from relnav.files.systems import SYSTEMS
from relnav.navigation.pose_epoch import EPOCH
from relnav.navigation.pose_record import PoseRecord

BEACONS = [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]]
MARKERS = [[459.0, 532.0], [562.0, 531.0], [511.0, 478.0]]


@pytest.mark.parametrize("name", relnav.list_models())
def test_a_model(name):
    """Name, sensor type, title, and where all values are; equality, copies and pickles as before."""
    model = relnav.load_model(name)
    text = repr(model)
    kind = next(kind for kind, system in SYSTEMS.items() if system.mission.endswith(f":{type(model).__name__}"))
    assert text.startswith(f"<{type(model).__name__} {name}, {kind}: {model.title}; all values: vars(model), with")
    assert text.endswith(f"relnav models {model.path}>")
    assert "\n" not in text
    assert dataclasses.replace(model) == model == copy.copy(model)
    assert pickle.loads(pickle.dumps(model)) == model
    assert repr(dataclasses.replace(model, path="")).endswith("all values: vars(model)>")


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_navigators(engine):
    beacons = relnav.Navigator(relnav.load_model("three_beacon_psd"), engine=engine)
    markers = relnav.PoseNavigator(relnav.load_model("three_marker_vision"), engine=engine)
    assert repr(beacons) == "Navigator(three_beacon_psd, fix, no step yet, WAITING for two images that agree)"
    assert repr(markers) == "PoseNavigator(three_marker_vision, no step yet, WAITING for two images that agree)"
    for t in (0.0, 0.1, 0.2):
        beacons.step(t, BEACONS)
        markers.step(t, MARKERS)
    assert repr(beacons) == repr(copy.deepcopy(beacons)) == "Navigator(three_beacon_psd, fix, t_s=0.2, with a state)"
    assert repr(markers) == "PoseNavigator(three_marker_vision, t_s=0.2, 1 pose possible)"


def test_a_record_of_markers_says_what_makes_it_unreliable():
    navigator = relnav.PoseNavigator(relnav.load_model("three_marker_vision"))
    record = [navigator.step(t, MARKERS) for t in (0.0, 0.1, 0.2)][-1]
    good = repr(record)
    assert good.startswith("PoseRecord(t_s=0.2, UPDATED, position ")
    assert good.endswith(" m)")
    memory = np.frombuffer(record._memory, np.uint8).copy()
    epoch = memory[: EPOCH.itemsize].view(EPOCH)
    epoch["hypotheses"], epoch["ambiguity"], epoch["observable"] = 2, 3.25, 0
    epoch["alarm"] = int(relnav.Alarm.STUCK)
    doubtful = repr(PoseRecord(memory.tobytes(), record._mission, record._chaser, None))
    said = f", 2 poses possible, AMBIGUOUS (3.2), NOT OBSERVABLE, ALARM {relnav.Alarm.STUCK.words})"
    assert doubtful == good[:-1] + said


def test_a_vehicle():
    navigator = relnav.VehicleNavigator(relnav.load_model("rendezvous_demo"))
    estimate = navigator.state()
    text = repr(estimate)
    assert text.startswith("VehicleEstimate(rendezvous_demo, t_s=0, port from port ")
    assert len(text) < 300
    assert repr(navigator) == f"VehicleNavigator of {text}"
    some = next(iter(estimate.sensors))
    health = dataclasses.replace(estimate.sensors[some], deviation=1e3)
    doubtful = dataclasses.replace(
        estimate, sensors={**estimate.sensors, some: health}, ambiguous=True, explanations=2, gyro_lost=True
    )
    assert f" m, AMBIGUOUS: 2 explanations, ALARM {some}, gyro lost)\n" in repr(doubtful)
