"""Every public call with what a program can hand over by mistake: shapes, types, sizes, times, rotations that are none.

A case is a good call with some of its arguments exchanged: numbers in an array, its shape, type, order or mask, or the
whole of it for something else. What must hold: an error is a ValueError with one printable sentence; none takes 5 s of
processor time; no warning; arguments stay as they were; where there is a value it is finite and its covariance positive
definite; a refused call leaves the object as it was, to the last bit, and a record that was returned never changes.

    python benchmarks/fuzzing_calls.py [--cases 1000] [--target "Navigator.step"] [--json FILE]

The test suite runs some of the same cases (tests/navigation/test_fuzzed_calls.py).
"""

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fuzzing import run_targets, try_cases
from fuzzing_more_calls import MORE
from fuzzing_values import OTHERS, asked, check_covariance, drawn, in_turn, like, number, rotation
from hypothesis import strategies as st

import relnav
from relnav.dynamics.in_frame import FRAMES
from relnav.sensors.sun_direction import attitude_observation
from relnav.spacecraft import POINTS

SPOTS_M = np.array([[-1.5e-3, 0.0], [1.5e-3, 0.0], [0.0, 0.0]])
SPOTS_PX = np.array([[469.3, 553.7], [553.7, 553.7], [511.5, 511.5]])
"""In the model's expected view: turned by half a turn they would start no track."""
LONGEST = 1e5
"""Epochs of a simulated flight; more are meant to take their time."""


@cache
def model(name: str) -> Any:
    """A shipped model."""
    return relnav.load_model(name)


def look_at_record(record: Any) -> None:
    """A beacon record: state and covariance whole, or none."""
    state = record.state
    if not record.has_state:
        assert np.isnan(state).all(), "no state at all"
        return
    assert np.isfinite(state).all(), "a state is finite"
    check_covariance(record.covariance)
    assert np.isfinite([record.range_m, record.azimuth_rad, record.elevation_rad]).all()


def navigator_step(data: Any) -> list[str]:
    """Images of one navigator, then a start from outside among them."""
    navigator = relnav.Navigator(model("three_beacon_psd"), data.draw(st.sampled_from(["fix", "spots"])))
    outcomes, t = [], 0.0
    kept: list[tuple[Any, bytes, bytes]] = []

    def look(record: Any) -> None:
        look_at_record(record)
        kept.append((record, record.state.tobytes(), record.covariance.tobytes()))

    for k in range(data.draw(st.integers(1, 7))):
        t += data.draw(st.sampled_from([0.1, 0.1, 0.1, 0.1, 1e-9, 10.0, 1e5, 1e300, 0.0, -1.0]))
        told, time_s, spots = {}, t, SPOTS_M
        if k >= 2:
            told = drawn(
                data,
                acceleration_m_s2=np.zeros(3),
                delta_v_m_s=np.zeros(3),
                dcm_cam_from_lvlh=model("three_beacon_psd").dcm_cam_from_lvlh,
                spot_sigma_m=np.full((3, 2), 1e-5),
                attitude_noise_rad=1e-3,
                attitude_sigma_rad=1e-3,
            )
            time_s, spots = data.draw(like(t)), data.draw(like(SPOTS_M))
        if k and data.draw(st.integers(0, 9)) == 9:
            start = data.draw(like([-10.0, 0, 0, 0, 0, 0])), data.draw(like(np.eye(6)))
            asked(navigator.start, time_s, *start)
        outcomes.append(in_turn(navigator, look, navigator.step, time_s, spots, **told))
        for record, state, covariance in kept:
            assert (record.state.tobytes(), record.covariance.tobytes()) == (state, covariance), (
                "a record never changes"
            )
    return outcomes


def look_at_pose(record: Any) -> None:
    """A pose record, likewise."""
    if not np.isnan(record.state).all():
        assert np.isfinite(record.state).all(), "a state is finite"
        assert np.isfinite(record.dcm_lvlh_from_target).all()
        check_covariance(record.covariance)


def pose_step(data: Any) -> list[str]:
    """Images of one pose navigator, some of them late."""
    navigator = relnav.PoseNavigator(model("three_marker_vision"))
    outcomes, t = [], 0.0
    for k in range(data.draw(st.integers(1, 6))):
        t += data.draw(st.sampled_from([0.1, 0.1, 0.1, 10.0, 1e5, 1e300, 0.0, -1.0]))
        told, time_s, spots = {}, t, SPOTS_PX
        if k >= 2:
            told = drawn(
                data,
                image_t_s=t - 0.05,
                acceleration_m_s2=np.zeros(3),
                delta_v_m_s=np.zeros(3),
                dcm_chaser_from_lvlh=model("three_marker_vision").dcm_chaser_from_lvlh,
                chaser_rate_rad_s=np.zeros(3),
                spot_covariance_px2=np.tile(0.01 * np.eye(2), (3, 1, 1)),
                attitude_noise_rad=1e-3,
                attitude_sigma_rad=1e-3,
            )
            time_s, spots = data.draw(like(t)), data.draw(like(SPOTS_PX))
        outcomes.append(in_turn(navigator, look_at_pose, navigator.step, time_s, spots, **told))
    return outcomes


def look_at_attitude(record: Any) -> None:
    """An attitude record."""
    if np.isfinite(record.dcm_lvlh_from_target).all():
        assert np.isfinite(record.rate_rad_s).all()
        check_covariance(record.covariance)


def target_attitude(data: Any) -> list[str]:
    """The target's attitude alone: its making and its epochs."""
    filter_ = asked(
        relnav.TargetAttitude,
        data.draw(like(np.diag([300.0, 400.0, 500.0]))),
        data.draw(like(1.1e-3)),
        rate_noise_density_rad2_s3=data.draw(like(1e-10)),
        initial_rate_sigma_rad_s=data.draw(like(1e-3)),
        method=data.draw(st.sampled_from(["multiplicative", "unscented"])),
        **drawn(data, 1, inertia_sigma_kg_m2=np.eye(3)),
        **drawn(data, 0, chaser_attitude_sigma_rad=0.0, restart_after=8, gate_probability=0.9999),
    )
    if filter_ is None:
        return ["refused"]
    outcomes, t = ["given"], 0.0
    for _ in range(data.draw(st.integers(1, 5))):
        t += data.draw(st.sampled_from([0.1, 0.1, 10.0, 1e5, 1e300, 0.0, -1.0]))
        told = [data.draw(like(t)), data.draw(like(rotation())), data.draw(like(1e-6 * np.eye(3)))]
        outcomes.append(
            in_turn(filter_, look_at_attitude, filter_.step, *told, **drawn(data, 1, dcm_chaser_from_lvlh=np.eye(3)))
        )
    return outcomes


def filter_epochs(data: Any) -> list[str]:
    """A log in memory, of beacons or of markers."""
    n = data.draw(st.integers(1, 12))
    if data.draw(st.booleans()):
        return marker_epochs(data, n)
    solution = asked(
        relnav.filter_epochs,
        model("three_beacon_psd"),
        data.draw(like(0.1 * np.arange(n))),
        data.draw(like(np.tile(SPOTS_M, (n, 1, 1)))),
        smooth=data.draw(st.booleans()),
        method=data.draw(st.sampled_from(["fix", "spots", "fix", "ekf"])),
        **drawn(
            data,
            acceleration_m_s2=np.zeros((n, 3)),
            delta_v_m_s=np.zeros((n, 3)),
            q_cam_from_lvlh=np.tile([0.5, -0.5, -0.5, -0.5], (n, 1)),
            spot_sigma_m=np.full((n, 3, 2), 1e-5),
        ),
    )
    if solution is None:
        return ["refused"]
    check_track(solution)
    degrees = data.draw(like([51.6, 10.0, 20.0], optional=True))
    track = asked(solution.in_frame, data.draw(st.sampled_from([*FRAMES, "lvlh"])), orientation_deg=degrees)
    if track is not None:
        check_track(track)
    asked(solution.nis_consistency, data.draw(like(0.95)))
    return ["given", "refused" if track is None else "given"]


def marker_epochs(data: Any, n: int) -> list[str]:
    """The same of markers."""
    solution = asked(
        relnav.filter_marker_epochs,
        model("three_marker_vision"),
        data.draw(like(0.1 * np.arange(n))),
        data.draw(like(np.tile(SPOTS_PX, (n, 1, 1)))),
        smooth=data.draw(st.booleans()),
        **drawn(
            data,
            image_t_s=0.1 * np.arange(n) - 0.05,
            acceleration_m_s2=np.zeros((n, 3)),
            delta_v_m_s=np.zeros((n, 3)),
            q_chaser_from_lvlh=np.tile([0.5, -0.5, -0.5, -0.5], (n, 1)),
            dcm_chaser_from_lvlh=np.tile(model("three_marker_vision").dcm_chaser_from_lvlh, (n, 1, 1)),
            spot_covariance_px2=np.tile(0.01 * np.eye(2), (n, len(SPOTS_PX), 1, 1)),
        ),
    )
    if solution is None:
        return ["refused"]
    check_track(solution)
    return ["given"]


def check_track(track: Any) -> None:
    """Each row a state with its covariance, or neither."""
    for state, covariance in zip(track.state, track.covariance, strict=True):
        if np.isfinite(state).all():
            check_covariance(covariance)
        else:
            assert np.isnan(state).all(), "a state is known whole or not at all"


def measured(found: Any, value: str, *, singular: bool = False) -> str:
    """Of a measurement: a value (the name of its attribute) with its covariance, or none."""
    if found is None:
        return "refused"
    ok = found.status.name == "OK"
    if ok:
        assert np.isfinite(getattr(found, value)).all(), "a value is finite"
        check_covariance(found.covariance, singular=singular)
    return "given" if ok else "no value"


def beacons(data: Any) -> list[str]:
    """One image of the beacons."""
    mission, spots = model("three_beacon_psd"), data.draw(like(SPOTS_M))
    form = data.draw(st.sampled_from([None, "perspective", "parallel", "none"]))
    places = asked(relnav.three_beacon.positions, spots, mission)
    assert places is None or np.isfinite(places).all()
    return [measured(asked(relnav.three_beacon.measure, spots, mission, projection=form), "value")]


def markers(data: Any) -> list[str]:
    """One image of the markers, labelled or not."""
    found = asked(
        relnav.three_marker.measure,
        data.draw(like(SPOTS_PX)),
        model("three_marker_vision"),
        spot_covariance_px2=data.draw(like(np.tile(0.01 * np.eye(2), (3, 1, 1)), optional=True)),
        labelled=data.draw(st.booleans()),
        method=data.draw(st.sampled_from(["exact", "small_angle"])),
    )
    return ["refused" if found is None else "given"]


def stars(data: Any) -> list[str]:
    """One frame of a star sensor, lost in space and near an attitude."""
    spots, sensor = data.draw(like(np.random.default_rng(0).uniform(-500, 500, (12, 2)))), model("dual_field_star")
    told = {
        "velocity_km_s": data.draw(like(np.zeros(3))),
        **drawn(data, flux=np.arange(12.0) + 1.0, epoch_jyear=2026.0),
        **drawn(data, 1, spot_covariance_px2=np.tile(0.005 * np.eye(2), (12, 1, 1))),
    }
    prior = data.draw(like(rotation())), data.draw(like(1e-3))
    found = asked(relnav.dual_field.measure, spots, sensor, **told)
    near = asked(relnav.dual_field.track, spots, sensor, *prior, **told)
    return ["refused" if entry is None else entry.status.name.lower() for entry in (found, near)]


def pictures(data: Any) -> list[str]:
    """Star spots of a picture, and the sun's."""
    image = np.random.default_rng(1).normal(100.0, 3.0, (24, 24))
    image[8:11, 9:12] += 400.0
    seen, told = data.draw(like(image)), drawn(data, saturation=4e3, electrons_per_count=2.0)
    found = asked(relnav.find_stars, seen, threshold_sigma=data.draw(like(5.0)), **told)
    sun = asked(relnav.aps_sun.measure, seen, model("aps_sun"), corner_px=data.draw(like([500.0, 500.0])))
    return ["refused" if found is None else "given", measured(sun, "direction", singular=True)]


def suns(data: Any) -> list[str]:
    """Spots of both sun sensors, and what an attitude filter is given."""
    outcomes = []
    noise = drawn(data, 1, covariance_px2=0.01 * np.eye(4))
    two = data.draw(like([[512.0, 512.0], [540.0, 512.0]]))
    for found in (
        asked(relnav.aps_sun.measure, data.draw(like([512.0, 512.0])), model("aps_sun")),
        asked(relnav.birefringent_sun.measure, two, model("birefringent_sun"), **noise),
    ):
        outcomes.append(measured(found, "direction", singular=True))
        if found is not None:
            told = data.draw(like([0.0, 0.0, 1.0])), data.draw(like(rotation()))
            seen = asked(attitude_observation, found, *told, sun_sigma_rad=data.draw(like(0.0)))
            outcomes.append("refused" if seen is None else "given")
    return outcomes


def models(data: Any) -> list[str]:
    """A shipped model with values exchanged."""
    name = data.draw(st.sampled_from([name for name in relnav.list_models() if name != "rendezvous_demo"]))
    value = number | st.sampled_from(OTHERS) | like([1.0, 2.0])
    changes = data.draw(st.dictionaries(st.sampled_from(_keys(name)), value, max_size=3))
    return ["refused" if asked(relnav.load_model, name, changes) is None else "given"]


@cache
def _keys(name: str) -> list[str]:
    from relnav.files.models import model_values

    return list(model_values(model(name)))


def simulated(data: Any) -> list[str]:
    """A short scenario with a number of its approach exchanged."""
    plan = relnav.Scenario()
    names = [key for key, value in vars(plan.approach).items() if isinstance(value, float)]
    changes = {"duration_s": 2.0, data.draw(st.sampled_from(names)): data.draw(number)}
    approach = asked(replace, plan.approach, **changes)
    if approach is None or not approach.duration_s * approach.rate_hz < LONGEST:
        return ["refused" if approach is None else "too long to try"]
    flown = asked(replace, plan, approach=approach)
    log = asked(relnav.simulate, model("three_beacon_psd"), flown, data.draw(like(3)), data.draw(like(1)))
    if log is not None:
        assert np.isfinite(log.truth).all(), "the truth is finite"
    return ["refused" if log is None else "given"]


def vehicle(data: Any) -> list[str]:
    """Observations of a whole vehicle."""
    flown = model("rendezvous_demo")
    start = drawn(
        data,
        1,
        position_m=[30.0, 0.0, 0.0],
        velocity_m_s=[-0.1, 0.0, 0.0],
        covariance=1e-4 * np.eye(data.draw(st.sampled_from([6, 12, 15]))),
        dcm_lvlh_from_target=rotation(),
        target_rate_rad_s=[0.0, 0.02, 0.0],
        dcm_inertial_from_chaser=rotation(0.5, 1),
    )
    navigator = asked(relnav.VehicleNavigator, flown, t_s=data.draw(like(0.0)), **start)
    if navigator is None:
        return ["refused"]
    outcomes, t = ["given"], 0.0
    for _ in range(data.draw(st.integers(1, 5))):
        t += data.draw(st.sampled_from([0.1, 0.1, 0.1, -0.2, 1e5, 1e300]))
        name = data.draw(st.sampled_from(["gyro", "thrust", *flown.sensor, "none"]))
        good = np.array([0.0, 0.0, 0.0, 1.0])
        if name in ("gyro", "thrust", "none"):
            good = np.zeros(3)
        elif flown.kind(name) == POINTS:
            good = np.zeros((len(flown.points_m(name)), 2))
        before = navigator.state().covariance
        when, value, noise = data.draw(like(t)), data.draw(like(good)), drawn(data, 1, covariance=1e-8 * np.eye(3))
        taken = asked(navigator.observe, name, when, value, **noise)
        estimate = navigator.state()
        assert taken is not None or np.array_equal(before, estimate.covariance), "a refused call leaves it as it was"
        assert np.isfinite(estimate.values).all(), "a state is finite"
        check_covariance(estimate.covariance, singular=True)
        ahead = asked(navigator.state, data.draw(like(t + 1.0)))
        outcomes += ["refused" if entry is None else "given" for entry in (taken, ahead)]
    return outcomes


CALLS: dict[str, Callable[[Any], list[str]]] = {
    "Navigator.step": navigator_step,
    "PoseNavigator.step": pose_step,
    "TargetAttitude.step": target_attitude,
    "filter_epochs": filter_epochs,
    "three_beacon.measure": beacons,
    "three_marker.measure": markers,
    "dual_field.measure": stars,
    "find_stars": pictures,
    "sun sensors' measure": suns,
    "load_model": models,
    "simulate": simulated,
    "VehicleNavigator.observe": vehicle,
    **MORE,
}


def fuzz(
    name: str, _folder: Path, cases: int, *, derandomize: bool = False, number: int | None = None
) -> dict[str, Any]:
    """Try so many cases of one call; what came of them. The first that must not be is raised, made small."""
    outcomes: Counter[str] = Counter()
    one = CALLS[name]
    try_cases(st.data(), lambda data: outcomes.update(one(data)), cases, derandomize=derandomize, number=number)
    return {"call": name, "cases": sum(outcomes.values()), "outcomes": dict(sorted(outcomes.items())), "faults": []}


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as _:
        run_targets(__doc__ or "", fuzz, lambda _folder: list(CALLS), "call")
