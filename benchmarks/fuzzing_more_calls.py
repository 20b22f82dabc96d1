"""Public calls that load, simulate, filter and write, with what a program can hand over by mistake."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fuzzing_values import OTHERS, asked, check_covariance, drawn, like, number
from hypothesis import strategies as st

import relnav

SPOTS = [f"spot_{beacon}_{axis}" for beacon in "abc" for axis in "xy"]
MARKERS = [469.3, 553.7, 553.7, 553.7, 511.5, 511.5]
BEACONS = [-1500.0, 0.0, 1500.0, 0.0, 0.0, 0.0]
ENDINGS = [".csv", ".jsonl", ".parquet", ".mat", ".nc", ".mcap", ".rosbag2", ".oem", ".aem", "", ".xyz"]


@cache
def model(name: str) -> Any:
    """A shipped model."""
    return relnav.load_model(name)


@cache
def solution(kind: str) -> Any:
    """A short track, of beacons or of markers, whose first epochs have no state."""
    n = 8
    if kind == "beacons":
        spots = 1e-6 * np.tile(np.reshape(BEACONS, (3, 2)), (n, 1, 1))
        return relnav.filter_epochs(model("three_beacon_psd"), 0.1 * np.arange(n), spots)
    import pandas

    table = pandas.DataFrame({"t_s": 0.1 * np.arange(n)} | _columns(MARKERS, "_px", n))
    return relnav.filter_marker_log(table, model("three_marker_vision"))


def _columns(values: list[float], unit: str, n: int) -> dict[str, Any]:
    return {name + unit: np.full(n, value) for name, value in zip(SPOTS, values, strict=True)}


def anything(data: Any, good: Any) -> Any:
    """A good value, mostly, or one of no sense."""
    return data.draw(st.sampled_from([good] * 6 + OTHERS)) if good is not None else data.draw(st.sampled_from(OTHERS))


def tables(data: Any) -> list[str]:
    """Logs as tables in memory, of both kinds of spots."""
    import pandas

    n, marked = data.draw(st.integers(1, 6)), data.draw(st.booleans())
    columns = {"t_s": 0.1 * np.arange(n)}
    columns |= _columns(MARKERS, "_px", n) if marked else _columns(BEACONS, "_um", n)
    extra = {"accel_x_m_s2": 0.0, "accel_y_m_s2": 0.0, "accel_z_m_s2": 0.0, "image_t_s": 0.0, "other": 1.0}
    columns |= {name: np.full(n, value) for name, value in extra.items() if data.draw(st.integers(0, 3)) == 3}
    for _ in range(data.draw(st.integers(0, 3))):
        name = data.draw(st.sampled_from(list(columns)))
        what = data.draw(st.sampled_from(["numbers", "numbers", "missing", "words", "objects", "dropped"]))
        if what == "numbers":
            columns[name] = np.array([data.draw(number) for _ in range(n)])
        elif what == "dropped":
            del columns[name]
            if not columns:
                return ["nothing left"]
        else:
            kinds = {"missing": [pandas.NA] * n, "words": ["1.0"] * n, "objects": [data.draw(st.sampled_from(OTHERS))]}
            columns[name] = pandas.Series((kinds[what] * n)[:n], dtype=object)
    frame = pandas.DataFrame(columns)
    flown = model("three_marker_vision" if marked else "three_beacon_psd")
    call = relnav.filter_marker_log if marked and data.draw(st.booleans()) else relnav.filter_log
    told = {"smooth": data.draw(st.booleans())} | ({} if call is relnav.filter_marker_log else drawn(data, 1))
    track = asked(call, anything(data, frame), flown, **told)
    if track is None:
        return ["refused"]
    for state, covariance in zip(track.state, track.covariance, strict=True):
        if np.isfinite(state).all():
            check_covariance(covariance)
    return ["given"]


def writing(data: Any) -> list[str]:
    """A track written in every format, with frames and epochs that are none."""
    kind = data.draw(st.sampled_from(["beacons", "beacons", "markers"]))
    told: dict[str, Any] = {}
    if data.draw(st.booleans()):
        told["epoch"] = anything(data, "2026-01-01T00:00:00")
    if data.draw(st.integers(0, 3)) == 3:
        told["frame"] = anything(data, "lvlh_ccsds")
    if data.draw(st.integers(0, 3)) == 3:
        told["orientation_deg"] = data.draw(like([51.6, 10.0, 20.0]))
    if data.draw(st.integers(0, 5)) == 5:
        told["model"] = anything(data, model("three_beacon_psd"))
    with TemporaryDirectory() as name:
        out = Path(name) / f"track{data.draw(st.sampled_from(ENDINGS))}"
        before = sorted(Path(name).iterdir())
        done = asked(lambda: (relnav.write(anything(data, solution(kind)), anything(data, out), **told), True))
        assert done is not None or sorted(Path(name).iterdir()) == before, "a refused call writes nothing"
    return ["refused" if done is None else "given"]


def loading(data: Any) -> list[str]:
    """What loads by name, and what is listed."""
    name = anything(data, "three_beacon_psd")
    changes = data.draw(
        st.dictionaries(
            st.sampled_from(["approach.duration_s", "spread.start_sigma_m", "images.dropout", "results.settling_s"]),
            number | st.sampled_from(OTHERS) | like([0.1, 0.1, 0.1]),
            max_size=2,
        )
    )
    calls: list[Callable[[], Any]] = [
        lambda: relnav.load_model(name),
        lambda: relnav.load_published(name),
        lambda: relnav.load_scenario(anything(data, None) if data.draw(st.booleans()) else None, changes),
        lambda: relnav.load_sun_calibration(anything(data, "nowhere.json")),
        relnav.list_models,
    ]
    call = data.draw(st.sampled_from(calls))
    return ["refused" if asked(call) is None else "given"]


def measuring(data: Any) -> list[str]:
    """The accuracy of a sensor system, in two runs."""
    flown = anything(data, model(data.draw(st.sampled_from(["birefringent_sun", "aps_sun"]))))
    report = asked(relnav.measure_accuracy, flown, runs=data.draw(like(2)), seed=data.draw(like(7)))
    return ["refused" if report is None else "given"]


def campaigns(data: Any) -> list[str]:
    """A campaign of two short flights."""
    short = relnav.load_scenario(None, {"approach.duration_s": 2.0, "approach.rate_hz": 2.0})
    table = asked(
        relnav.campaign,
        anything(data, model("three_beacon_psd")),
        anything(data, 2),
        anything(data, 3),
        dispersions=anything(data, short),
        method=anything(data, "fix"),
        workers=anything(data, 1),
    )
    return ["refused" if table is None else "given"]


def solutions(data: Any) -> list[str]:
    """What a track is asked."""
    track = solution(data.draw(st.sampled_from(["beacons", "markers"])))
    calls: list[Callable[[], Any]] = [
        lambda: track.in_frame(anything(data, "lvlh_ccsds"), orientation_deg=data.draw(like([51.6, 10.0, 20.0]))),
        lambda: track.to_dataframe() if hasattr(track, "to_dataframe") else 0,
        lambda: track.nis_consistency(data.draw(like(0.95))) if hasattr(track, "nis_consistency") else 0,
        lambda: len(track),
    ]
    return ["refused" if asked(data.draw(st.sampled_from(calls))) is None else "given"]


MORE: dict[str, Callable[[Any], list[str]]] = {
    "filter_log": tables,
    "write": writing,
    "loaders": loading,
    "measure_accuracy": measuring,
    "campaign": campaigns,
    "Solution": solutions,
}
"""Beside those of fuzzing_calls.py."""


COVERED = {
    "Navigator": "Navigator.step",
    "PoseNavigator": "PoseNavigator.step",
    "TargetAttitude": "TargetAttitude.step",
    "VehicleNavigator": "VehicleNavigator.observe",
    "Scenario": "simulate",
    "Solution": "Solution",
    "aps_sun": "sun sensors' measure",
    "birefringent_sun": "sun sensors' measure",
    "campaign": "campaign",
    "dual_field": "dual_field.measure",
    "filter_epochs": "filter_epochs",
    "filter_marker_epochs": "filter_epochs",
    "filter_log": "filter_log",
    "filter_marker_log": "filter_log",
    "find_stars": "find_stars",
    "list_models": "loaders",
    "load_model": "load_model",
    "load_published": "loaders",
    "load_scenario": "loaders",
    "load_sun_calibration": "loaders",
    "measure_accuracy": "measure_accuracy",
    "simulate": "simulate",
    "three_beacon": "three_beacon.measure",
    "three_marker": "three_marker.measure",
    "write": "write",
}
"""Public name -> the target of fuzzing_calls.py that calls it."""
NOT_CALLED = {
    **dict.fromkeys(("InputError", "LogError", "ModelError", "UsageError"), "an error: relnav raises it"),
    **dict.fromkeys(("Alarm", "EpochStatus", "Status"), "an enumeration of the standard library"),
    **dict.fromkeys(("FilterRecord", "Measurement"), "a result: relnav makes it, and the targets look at it"),
    **dict.fromkeys(("AccuracyReport", "Consistency"), "a result: relnav makes it, and it takes no arguments"),
    "Model": "made by load_model from a file; a program that makes its own is held by its types",
}
"""Public names that no target calls, and why."""
