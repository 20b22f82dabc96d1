"""Raw logs: read as written, filtered into a track, and refused by line and column."""

import dataclasses
import re

import numpy as np
import pytest

import relnav
from relnav.files.filter_log import filter_log
from relnav.files.raw_filter import slots_of_log
from relnav.files.raw_logs import is_raw_log, read_raw_log
from relnav.files.simulated import write_raw_log
from relnav.sensors.three_beacon.psd import currents_of_counts
from relnav.simulation.raw import simulate_raw
from relnav.simulation.trajectory import Approach

HEADER = "t_s,beacon,adc_x1,adc_x2,adc_y1,adc_y2"
ROW = "{t},{beacon},2000,2100,2050,2060"


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def flown(model):
    return simulate_raw(model, Approach(duration_s=30.0, start_m=(7.0, 0.05, -0.05), final_range_m=6.0), seed=1)


@pytest.fixture
def rows():
    """A good raw log as a list of lines."""
    return [HEADER, *(ROW.format(t=0.025 * k, beacon=("a", "b", "c", "dark")[k % 4]) for k in range(8))]


def test_counts_come_back_as_written(flown, tmp_path):
    write_raw_log(flown, tmp_path / "raw.csv", {"seed": "1"})
    raw = read_raw_log(tmp_path / "raw.csv")
    np.testing.assert_array_equal(raw.t_s, flown.t_s)
    np.testing.assert_array_equal(raw.beacon, flown.beacon)
    np.testing.assert_array_equal(raw.counts, flown.counts)
    np.testing.assert_array_equal(raw.acceleration_m_s2, flown.acceleration_m_s2)
    assert raw.currents_a is None
    assert raw.metadata["seed"] == "1"


def test_a_raw_log_is_filtered_into_a_track_near_the_truth(model, flown, tmp_path):
    write_raw_log(flown, tmp_path / "raw.csv")
    track = filter_log(tmp_path / "raw.csv", model, method="spots")
    assert len(track) == len(flown.t_s)
    assert track.metadata["slots"] == f"ok {len(flown.t_s)}"
    assert re.fullmatch(r"(8|9|1\d)(\.\d+)? um rms, from the received power", track.metadata["spot noise"])
    error = (track.state - flown.truth)[-1]
    assert np.linalg.norm(error[:3]) < 0.015
    smoothed = filter_log(tmp_path / "raw.csv", model, smooth=True, method="spots")
    assert smoothed.smoothed
    assert np.isfinite(smoothed.state[-1]).all()


def test_currents_in_any_unit_are_the_counts(model, flown, write_log):
    currents = currents_of_counts(model.detector, flown.counts[:8])
    for unit, scale in (("na", 1e9), ("ua", 1e6), ("a", 1.0)):
        header = "t_s,beacon," + ",".join(f"current_{name}_{unit}" for name in ("x1", "x2", "y1", "y2"))
        body = [
            f"{t!r},{name},{','.join(repr(float(x) * scale) for x in row)}"
            for t, name, row in zip(flown.t_s[:8].tolist(), "abcdabcd".replace("d", "D"), currents, strict=True)
        ]
        text = "\n".join([header, *body]).replace(",D,", ",dark,")
        raw = read_raw_log(write_log(text))
        np.testing.assert_allclose(raw.currents_a, currents, rtol=1e-12)
        assert raw.counts is None


def test_which_logs_are_raw(write_log, rows, vbar_log):
    assert is_raw_log(write_log("\n# a = 1\n" + "\n".join(rows)))
    assert not is_raw_log(vbar_log)
    assert not is_raw_log(write_log(b"\xff\xfe"))
    assert not is_raw_log(write_log(""))


def test_missing_and_saturated_slots(model, write_log, rows):
    rows[1] = "0.0,A,,2100,2050,2060"
    rows[6] = "0.125,b,2000,65535,2050,2060"
    slots = slots_of_log(read_raw_log(write_log("\n".join(rows))), model)
    assert [code.name for code in map(type_of, slots.status[[0, 5]])] == ["MISSING", "SATURATED"]


def type_of(code):
    from relnav.sensors.three_beacon.psd import SlotStatus

    return SlotStatus(int(code))


# name: (line 3 of the file, text of the message after "path:3: ")
WRONG = {
    "beacon": ("0.025,d,1,2,3,4", "column 'beacon': one of a, b, c, dark is expected; got 'd'"),
    "short": ("0.025,b,1,2,3", "6 cells are expected as in the header; got 5"),
    "text": ("0.025,b,1,two,3,4", "column 'adc_x2': 'two' is not a number"),
    "underscore": ("0.025,b,1,2_0,3,4", "column 'adc_x2': '2_0' is not a number"),
    "below zero": ("0.025,b,1,-2,3,4", "column 'adc_x2': -2 is no count of a converter; counts are from 0 up"),
    "no number": ("0.025,b,1,inf,3,4", "column 'adc_x2': inf is no count of a converter; counts are from 0 up"),
    "no time": (",b,1,2,3,4", "column 't_s' is empty or not finite; only a current may be"),
    "time repeats": ("0.0,b,1,2,3,4", "time 0 s is not after 0 s of the row before; sort the log by time"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_row_is_named_by_its_line(write_log, rows, name):
    rows[2], text = WRONG[name]
    path = write_log("\n".join(rows))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:3: {text}")):
        filter_log(path, "three_beacon_psd", method="spots")


HEADERS = {
    "missing": ("adc_y2", "voltage", "column 'adc_y2' is missing; the columns are t_s, beacon"),
    "time unit": ("t_s", "t_m", "column 't_m': unit 'm' does not fit; write one of t_s"),
    "repeated": ("adc_y2", "adc_y1", "column 'adc_y1' repeats 'adc_y1'; keep one"),
    "current unit": ("adc_x1", "current_x1_um", "column 'current_x1_um': unit 'um' does not fit; write one of current"),
    "both kinds": (
        "adc_y2",
        "adc_y2,current_x1_na",
        "columns of counts (adc_x1) and of currents (current_x1) are both",
    ),
    "no currents": ("adc_x1,adc_x2,adc_y1,adc_y2", "a,b,d,e", "column 'current_x1_na' is missing; the columns are"),
}


@pytest.mark.parametrize("name", HEADERS)
def test_a_wrong_header(write_log, rows, name):
    old, new, text = HEADERS[name]
    rows[0] = rows[0].replace(old, new)
    path = write_log("\n".join(rows))
    with pytest.raises(relnav.LogError, match=re.escape(f"{path}:1: {text}")):
        read_raw_log(path)


def test_a_header_alone(write_log, rows):
    path = write_log(rows[0])
    with pytest.raises(relnav.LogError, match="no rows after the header; one row a slot is expected"):
        read_raw_log(path)


def test_a_log_of_another_converter(model, write_log, rows):
    path = write_log("\n".join(rows))
    other = dataclasses.replace(model, detector=dataclasses.replace(model.detector, adc_bits=11))
    text = f"{path}: adc_x2 is 2100 at 0 s, but the model's converter of adc_bits = 11 ends at 2047"
    with pytest.raises(relnav.LogError, match=re.escape(text)):
        filter_log(path, other, method="spots")


def test_a_log_without_the_models_dark_slots(model, write_log, rows):
    path = write_log("\n".join(row for row in rows if ",dark," not in row))
    with pytest.raises(
        relnav.LogError, match=re.escape(f"{path}: no row is of beacon 'dark', but the model's [pulses]")
    ):
        filter_log(path, model, method="spots")
    without = dataclasses.replace(model, pulses=dataclasses.replace(model.pulses, dark_slot=False))
    assert filter_log(path, without, method="spots").metadata["slots"] == "ok 6"


def test_a_quaternion_that_is_no_rotation(write_log, rows):
    rows[0] += "".join(f",q_cam_from_lvlh_{axis}" for axis in "xyzw")
    rows[1:] = [row + ",0.5,-0.5,-0.5,-0.5" for row in rows[1:]]
    rows[3] = rows[3].replace("-0.5,-0.5,-0.5", "0,0,0")
    path = write_log("\n".join(rows))
    with pytest.raises(
        relnav.LogError, match=re.escape(f"{path}:4: q_cam_from_lvlh [0.5, 0.0, 0.0, 0.0] is not a unit")
    ):
        filter_log(path, "three_beacon_psd", method="spots")


def test_no_noise_is_stated_where_no_slot_holds_a_spot(model, write_log, rows):
    rows[1:] = [row.replace(",2000,", ",65535,") for row in rows[1:]]
    assert (
        filter_log(write_log("\n".join(rows)), model, method="spots").metadata["spot noise"]
        == "not known: no slot holds a spot"
    )


def test_a_model_without_a_detector(model, write_log, rows):
    path = write_log("\n".join(rows))
    with pytest.raises(relnav.ModelError, match=r"a raw log is read with the model's \[detector\] and \[pulses\]"):
        filter_log(path, dataclasses.replace(model, detector=None), method="spots")


def test_beacons_exchanged_from_the_start_are_not_called_well(model, flown, tmp_path):
    """Without a track nothing is judged; the start says SWAPPED."""
    exchanged = dataclasses.replace(flown, beacon=np.array([1, 0, 2, 3])[flown.beacon])
    write_raw_log(exchanged, tmp_path / "raw.csv")
    track = filter_log(tmp_path / "raw.csv", model, method="spots")
    assert track.metadata["beacons"] == "not judged: there is no track"
    assert (track.measurement_status == relnav.Status.SWAPPED).any()
