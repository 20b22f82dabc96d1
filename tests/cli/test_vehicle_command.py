"""A vehicle on the command line: its log, its track against truth, rows in any order, and what is refused."""

import json
import os
import random
import re
import threading
from types import SimpleNamespace

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

import relnav
from relnav.cli.vehicle import Summary
from relnav.files.model_folders import find_model
from relnav.files.vehicle_log import filter_vehicle_log, smoothed_rows
from relnav.files.vehicle_notes import attitude_note
from relnav.vehicle.health import SensorHealth

HEADER = "t_s,sensor,v0,v1,v2,v3,v4,v5,v6,v7,v8,v9,v10,v11"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The shipped vehicle, sampled slower."""
    text = find_model("rendezvous_demo").read_text(encoding="utf-8")
    for rate in ("100.0", "10.0", "5.0"):
        assert f"rate_hz = {{ value = {rate}" in text
        text = text.replace(f"rate_hz = {{ value = {rate}", f"rate_hz = {{ value = {float(rate) / 5.0}")
    path = tmp_path_factory.mktemp("vehicle") / "slow.toml"
    path.write_text(text, encoding="utf-8")
    return path


def table(path):
    lines = [line for line in path.read_text().splitlines() if line[0] != "#"]
    return np.genfromtxt(lines, delimiter=",", names=True)


@pytest.fixture
def log(run, model, tmp_path):
    arguments = ["--final-range", "29", "--out", tmp_path / "log.csv", "--truth", tmp_path / "truth.csv", "--seed", "5"]
    code, out, error = run("simulate", model, *arguments)
    assert (code, error) == (0, "")
    assert re.match(r"log: .*log\.csv \(\d+ observations, model slow, seed 5\)", out)
    return tmp_path / "log.csv"


def test_the_track_is_that_of_the_truth_in_any_order_of_rows(run, model, log, tmp_path):
    code, out, error = run("filter", log, "--model", model, "--out", tmp_path / "track.csv")
    assert (code, error) == (0, "")
    assert "star: last used at" in out
    track, truth = table(tmp_path / "track.csv"), table(tmp_path / "truth.csv")
    assert len(track) >= len(truth) >= 8
    for k, t in enumerate(truth["t_s"]):
        assert track["t_s"][k] == t
        for name in ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "rate_x_deg_s", "rate_z_deg_s"):
            assert abs(track[name][k] - truth[name][k]) < 4.5 * track[f"sigma_{name}"][k], (name, t)
    assert track["sigma_x_m"][-1] < 0.2
    head, *rows = [line for line in log.read_text().splitlines() if line[0] != "#"]
    random.Random(1).shuffle(rows)
    (tmp_path / "shuffled").mkdir()
    other = tmp_path / "shuffled" / "log.csv"
    other.write_text("\n".join([head, *rows]) + "\n")
    assert run("filter", other, "--model", model, "--out", tmp_path / "other.csv", "--quiet")[0] == 0
    assert (tmp_path / "other.csv").read_bytes() == (tmp_path / "track.csv").read_bytes()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0.1,lidar,1,2,3" + "," * 9, "log.csv:2: no sensor 'lidar' in model slow; there are gyro, thrust, camera"),
        ("0.1,gyro,1,2" + "," * 10, "log.csv:2: gyro has 3 values; one is empty"),
        ("0.1,gyro,1,2,3,4" + "," * 8, "log.csv:2: gyro has 3 values, v0 to v2; the other cells stay empty"),
        ("0.1,gyro,1,2,three" + "," * 9, "log.csv:2: column 'v2': 'three' is not a number"),
        (",gyro,1,2,3" + "," * 9, "log.csv:2: column 't_s': a time is expected; got ''"),
        ("0.1,gyro,1,2,3", "log.csv:2: 14 cells are expected as in the header; got 5"),
        ("0.1,sun_aps,1,1,0,1,1,1,1,1,1,,,", "log.csv:2: sun_aps: v0 to v2 are a unit vector"),
        ("", "no row after the header; one an observation is expected"),
    ],
)
def test_a_bad_row_is_told_by_its_line(run, model, tmp_path, row, message):
    path = tmp_path / "log.csv"
    path.write_text(f"{HEADER}\n{row}\n")
    code, _, error = run("filter", path, "--model", model)
    assert code == 3
    assert message in error


def test_parquet_is_the_csv(run, model, log, tmp_path):
    """The same observations, the same bits of the track; its columns and units stand in the file."""
    other = tmp_path / "log.parquet"
    assert run("simulate", model, "--final-range", "29", "--out", other, "--seed", "5", "--quiet")[0] == 0
    stored = parquet.read_table(other)
    assert stored.column_names == HEADER.split(",")
    assert stored.schema.metadata[b"seed"] == b"5"
    assert stored.schema.field("t_s").metadata == {b"unit": b"s"}
    for path, track in ((log, "a.csv"), (other, "b.csv")):
        code, _, error = run("filter", path, "--model", model, "--out", tmp_path / track, "--quiet")
        assert (code, error) == (0, "")
    lines = [
        [line for line in (tmp_path / name).read_text().splitlines() if line[0] != "#"] for name in ("a.csv", "b.csv")
    ]
    assert lines[0] == lines[1]
    code, _, error = run("filter", "--follow", other, "--model", model)
    assert (code, "--follow reads CSV, row by row" in error) == (2, True)


def test_smoothed_it_ends_where_the_filter_does_and_is_tighter_before(run, model, log, tmp_path):
    for name, more in (("a.csv", []), ("b.csv", ["--smooth"])):
        code, out, error = run("filter", log, "--model", model, "--out", tmp_path / name, *more)
        assert (code, error) == (0, "")
        assert "port from port at" in out
    forward, back = table(tmp_path / "a.csv"), table(tmp_path / "b.csv")
    assert forward.dtype.names == back.dtype.names
    np.testing.assert_array_equal(forward["t_s"], back["t_s"])
    np.testing.assert_array_equal(forward["used_psd"], back["used_psd"])
    for axis in "xyz":
        assert (back[f"sigma_{axis}_m"][:-2] < forward[f"sigma_{axis}_m"][:-2]).all()  # the last row stands twice
        np.testing.assert_allclose(back[f"{axis}_m"][-1], forward[f"{axis}_m"][-1], atol=1e-9)
    assert "# method = smoothed" in (tmp_path / "b.csv").read_text()
    vehicle = relnav.load_model(model)
    estimates = filter_vehicle_log(log, vehicle, smooth=True)
    assert [one.port.position_m[0] for one in estimates] == back["x_m"].tolist()
    assert len(filter_vehicle_log(log, vehicle, every_s=2.0)) == 1 + len(forward) // 2
    with pytest.raises(relnav.UsageError, match="every_s is a time above 0 s; got 0"):
        filter_vehicle_log(log, vehicle, every_s=0)
    with pytest.raises(relnav.InputError, match=r"at 1000000\.0 s: .*after such a gap start anew"):
        smoothed_rows([("gyro", 1.0, [0.0] * 3), ("gyro", 1e6, [0.0] * 3)], vehicle)


def test_a_budget(run, model, tmp_path):
    code, out, error = run("budget", model, "--json", tmp_path / "b.json")
    assert (code, error) == (0, "")
    assert out.startswith(
        "model slow: port from port on the planned approach from 30 m, 1-sigma as the filter reports it\n"
    )
    figures = json.loads((tmp_path / "b.json").read_text())
    assert [row["range_m"] for row in figures["rows"]] == [25.0, 10.0, 6.5, 5.0, 3.0, 1.0]
    along = {one["name"]: one["shares"]["along"] for one in figures["sources"]}
    assert max(along, key=along.get) == "camera focal"


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"sensor": ["lidar"]}, "log.parquet:1: no sensor 'lidar' in model slow; there are gyro, thrust, camera"),
        ({"sensor": [None]}, "log.parquet:1: no sensor '' in model slow"),
        ({"sensor": [1.0]}, "log.parquet: column 'sensor' holds double; words are expected"),
        ({"v1": [None]}, "log.parquet:1: gyro has 3 values; one is empty"),
        ({"v3": [4.0]}, "log.parquet:1: gyro has 3 values, v0 to v2; the other cells stay empty"),
        ({"v2": ["three"]}, "log.parquet: column 'v2' holds string; numbers are expected"),
        ({"v2": [2**60]}, "log.parquet: damaged after row 0: "),
        ({"t_s": [None]}, "log.parquet:1: column 't_s': a time is expected; got ''"),
        ({"t_s": []}, "log.parquet: no row after the header"),
        ({"w": [1.0]}, "log.parquet:1: a vehicle's log has columns t_s, sensor, v0, v1, ...; got t_s, sensor, v0, v1"),
    ],
)
def test_a_bad_row_of_parquet_is_told_by_its_number(run, model, tmp_path, changed, message):
    columns = {"t_s": [0.1], "sensor": ["gyro"], "v0": [1.0], "v1": [2.0], "v2": [3.0], "v3": [None]} | changed
    rows = min(map(len, columns.values()))
    types = {name: pyarrow.string() if name == "sensor" else pyarrow.float64() for name in columns}
    arrays = [
        pyarrow.array(values[:rows], type=None if values and values[0] is not None else types[name])
        for name, values in columns.items()
    ]
    parquet.write_table(pyarrow.table(arrays, names=list(columns)), tmp_path / "log.parquet")
    code, _, error = run("filter", tmp_path / "log.parquet", "--model", model)
    assert code == 3
    assert message in error


@pytest.mark.parametrize(
    ("order", "signs", "reading"),
    [
        ([3, 0, 1, 2], [1, 1, 1, 1], "scalar first (w, x, y, z)"),
        ([0, 1, 2, 3], [-1, -1, -1, 1], "the inverse rotation (inertial_from_sensor)"),
        ([0, 1, 2, 3], [1, 1, 1, 1], ""),
    ],
)
def test_a_star_sensors_quaternion_read_another_way(run, model, log, tmp_path, order, signs, reading):
    """Written by a caller with another convention: told in a sentence, which healthy rows do not get."""
    lines = log.read_text().splitlines()
    for k, line in enumerate(lines):
        cells = line.split(",")
        if len(cells) > 2 and cells[1] == "star":
            q = [float(cell) for cell in cells[2:6]]
            cells[2:6] = [repr(sign * q[place]) for place, sign in zip(order, signs, strict=True)]
            lines[k] = ",".join(cells)
    other = tmp_path / "other.csv"
    other.write_text("\n".join(lines) + "\n")
    code, out, _ = run("filter", other, "--model", model)
    assert code == 0
    if not reading:
        assert "quaternion" not in out
        return
    assert "star's quaternion turns " in out
    assert f"deg away from the attitude that is held; read as {reading} it is " in out
    assert "x, y, z, w of v_sensor = R v_inertial is expected" in out


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ("star", "deg off the attitude that is held: check q_sensor_from_chaser, that t_s = 0 is epoch_utc"),
        ("sun_aps", "deg off that of the attitude that is held: check q_sensor_from_chaser and that"),
        ("psd", "check q_sensor_from_chaser, position_m, pattern_position_m, and the order and unit of its spots"),
    ],
)
def test_a_sensor_that_is_refused_from_the_start(run, model, log, tmp_path, sensor, words):
    """A file that says wrong how a sensor is mounted: an alarm, and what to check."""
    wrong, text = tmp_path / "wrong.toml", model.read_text()
    section = text.index(f"[sensor.{sensor}]")
    place = text.index("q_sensor_from_chaser", section)
    turned = 'q_sensor_from_chaser = { value = [0.0, 0.6, 0.0, 0.8], source = "assumed", why = "a mistake" }'
    wrong.write_text(text[:place] + turned + text[text.index("\n", place) :])
    code, out, _ = run("filter", log, "--model", wrong, "--out", tmp_path / "track.csv")
    assert code == 0
    track = table(tmp_path / "track.csv")
    assert track[f"alarm_{sensor}"][-1] == 1
    (said,) = [line for line in out.splitlines() if line.startswith(f"{sensor}: ") and "refused" in line]
    assert "observations in a row were refused, up to the last" in said
    assert words in said
    assert f"ALARM {sensor} in " in out


def test_a_log_that_counts_from_another_zero(run, model, log, tmp_path):
    """Unix time, where the file's orbit is that of `epoch_utc`: stars and sun are elsewhere then."""
    lines = log.read_text().splitlines()
    for k, line in enumerate(lines):
        if line[0].isdigit():
            t_s, rest = line.split(",", 1)
            lines[k] = f"{float(t_s) + 1.8e9!r},{rest}"
    other = tmp_path / "unix.csv"
    other.write_text("\n".join(lines) + "\n")
    code, out, _ = run("filter", other, "--model", model)
    assert code == 0
    (said,) = [line for line in out.splitlines() if line.startswith("star: ") and "refused" in line]
    assert "that t_s = 0 is epoch_utc, with the target at true_anomaly" in said


def test_what_is_not_for_a_vehicle(run, model, vbar_log, tmp_path):
    code, _, error = run("filter", vbar_log, "--model", model)
    assert (code, "a vehicle's log has columns t_s, sensor, v0, v1, ..." in error) == (3, True)
    code, _, error = run("filter", vbar_log, "--model", model, "--method", "spots")
    assert (code, "--method is not for a vehicle" in error) == (2, True)
    code, _, error = run("filter", "--follow", vbar_log, "--model", model, "--smooth")
    assert (code, "--smooth" in error) == (2, True)
    code, _, error = run("simulate", model, "--out", tmp_path / "log.csv", "--j2")
    assert (code, "--j2 is not for a vehicle" in error) == (2, True)
    code, _, error = run("simulate", model, "--out", tmp_path / "log.mat")
    assert (code, "a table ends in .csv or .parquet; got '.mat'" in error) == (2, True)
    code, _, error = run("filter", vbar_log, "--model", model, "--out", tmp_path / "track.oem")
    assert (code, "a table ends in .csv, .jsonl or .parquet; got '.oem'" in error) == (2, True)
    assert list(tmp_path.iterdir()) == []


def without_samples(log, path, every, gaps):
    """The log without each sample whose number this divides of the gyro, and without those of these times."""
    lines, number = [], 0
    for line in log.read_text().splitlines(keepends=True):
        t_s, _, rest = line.partition(",")
        if rest.startswith("gyro,"):
            number += 1
            if number % every == 0 or any(begin < float(t_s) < end for begin, end in gaps):
                continue
        lines.append(line)
    path.write_text("".join(lines))
    return path


@pytest.mark.parametrize(
    ("every", "gaps", "said"),
    [
        (1000, [], None),
        (8, [], None),
        (2, [], r"samples are 0\.1 s apart on average, and 0\.05 s by its rate_hz: if none is missing, state .*"),
        (
            1000,
            [(2.02, 3.02), (4.02, 4.52)],
            r"gaps of 1\.6 s in [\d.]+ s, the longest 1\.05 s from 2\.00 s on; there the last rate is held, .*",
        ),
        (1000, [(3.02, 1e3)], r"gaps of ([\d.]+) s in [\d.]+ s, the longest \1 s from 3\.00 s on; .*"),
        (1, [], r"no row; the chaser's rate is learnt from the other sensors"),
    ],
)
def test_gaps_of_the_gyro_are_in_the_summary(run, model, log, tmp_path, every, gaps, said):
    left = without_samples(log, tmp_path / "left.csv", every, gaps)
    code, out, _ = run("filter", left, "--model", model, "--out", tmp_path / "track.csv")
    assert code == 0
    lines = [line for line in out.splitlines() if line.startswith("gyro:")]
    assert len(lines) == (said is not None)
    assert all(re.fullmatch(f"gyro: {said}", line) for line in lines)


def test_alarms_are_in_the_summary():
    """Of each sensor: when first, and in how many estimates."""
    vehicle = relnav.load_model("rendezvous_demo")
    port = SimpleNamespace(sigma=np.ones(12), position_m=np.zeros(3))
    good = {"camera": SensorHealth(1.0, 0, 1.0, 0.5)}
    summary = Summary(vehicle)
    raised = [{}, {"camera": 10.4}, {"camera": 11.7}, {"camera": 11.5}]  # the last was noted by one estimate alone
    for t_s, last_s in zip((10.0, 11.0, 12.0, 13.0), raised, strict=True):
        told = {"t_s": t_s, "sensors": good, "port": port, "ambiguous": False, "restarts": 0}
        alarms = ("camera",) if t_s in {11.0, 12.0} else ()
        first_s = dict.fromkeys(last_s, 10.4)
        list(summary.passing([SimpleNamespace(**told, alarms=alarms, first_alarm_s=first_s, last_alarm_s=last_s)]))
    assert summary.figures()["alarms"] == {"camera": {"first_s": 10.4, "last_s": 11.7, "estimates": 2}}
    (said,) = [line for line in summary.lines("log.csv") if line.startswith("ALARM")]
    assert said.startswith("ALARM camera in 2 of 4 estimates, raised first at 10.40 s and last at 11.70 s: ")


def test_where_the_targets_attitude_is_not_known_yet(run, model, log, tmp_path):
    """Ten images of lights have to agree; a column and a line of the summary say where they did not yet."""
    seeking = tmp_path / "seeking.toml"
    known = "target_attitude_sigma_deg = { value = 0.5,"
    assert known in model.read_text()
    seeking.write_text(model.read_text().replace(known, "target_attitude_sigma_deg = { value = 180.0,"))
    code, out, _ = run("filter", log, "--model", seeking, "--out", tmp_path / "track.csv")
    assert code == 0
    track = table(tmp_path / "track.csv")
    waiting = int(np.argmax(track["ambiguous"] == 0))
    assert 3 <= waiting <= 5  # three images a second of the two sensors together
    assert (track["ambiguous"] == (np.arange(len(track)) < waiting)).all()
    assert f"the target was looked for in {waiting} of {len(track)} estimates, at the start or after a lock-out" in out
    truth = table(tmp_path / "truth.csv")
    for name in ("x_m", "y_m", "z_m", "rate_x_deg_s"):
        off = track[name][waiting : len(truth)] - truth[name][waiting:]
        assert (np.abs(off) < 4.5 * track[f"sigma_{name}"][waiting : len(truth)]).all()
    rows = log.read_text().splitlines(keepends=True)
    early = [row for row in rows if not row[0].isdigit() or float(row.split(",")[0]) < 1.5]
    (tmp_path / "early.csv").write_text("".join(early))
    code, _, error = run("filter", tmp_path / "early.csv", "--model", seeking, "--smooth", "--out", tmp_path / "s.csv")
    assert code == 3
    assert "attitudes of the target that explain what was seen" in error
    assert not (tmp_path / "s.csv").exists()


def test_a_frame_adds_the_centre_of_mass_and_the_target(run, model, tmp_path):
    """Followed too; what the ports have is the same as without."""
    log, rows = tmp_path / "log.csv", [f"{0.1 * k:.1f},gyro,1e-4,-1e-3,2e-4" + "," * 9 for k in range(25)]
    log.write_text("\n".join([HEADER, *rows]) + "\n")
    arguments = ["filter", log, "--model", model, "--quiet", "--out"]
    assert run(*arguments, tmp_path / "plain.csv")[0] == 0
    assert run(*arguments, tmp_path / "track.csv", "--frame", "eci")[0] == 0
    plain, track = table(tmp_path / "plain.csv"), table(tmp_path / "track.csv")
    assert len(track) == len(plain) == 3
    for name in plain.dtype.names:
        np.testing.assert_array_equal(track[name], plain[name])
    distance = np.linalg.norm([track[f"com_{axis}_m"] for axis in "xyz"], axis=0)
    assert ((distance > 6.6e6) & (distance < 7.2e6)).all()
    np.testing.assert_allclose(sum(track[f"q_eci_from_target_{axis}"] ** 2 for axis in "xyzw"), 1.0, atol=1e-12)
    assert "# frame of com_, q_ and cov_com_ columns = eci: " in (tmp_path / "track.csv").read_text()
    code, _, error = run(*arguments, tmp_path / "a.csv", "--frame", "rsw", "--orbit-deg", "1", "2", "3")
    assert (code, "--orbit-deg is not for a vehicle" in error) == (2, True)
    if os.name != "nt":
        os.mkfifo(tmp_path / "pipe")
        writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=(log.read_text(),))
        writer.start()
        asked = ["filter", "--follow", tmp_path / "pipe", "--model", model, "--quiet", "--frame", "eci", "--out"]
        assert run(*asked, tmp_path / "live.csv")[0] == 0
        writer.join()
        live = table(tmp_path / "live.csv")
        assert live.dtype.names == track.dtype.names
        for name in track.dtype.names:  # column by column: numbers that are not known are equal too
            np.testing.assert_array_equal(live[name], track[name])


@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
def test_followed_it_is_the_track_of_the_whole_log(run, model, log, tmp_path):
    """Rows in the order of time; one that is none is told and left out."""
    head, *rows = [line for line in log.read_text().splitlines() if line[0] != "#"]
    rows.sort(key=lambda row: float(row.split(",")[0]))
    (tmp_path / "sorted.csv").write_text("\n".join([head, *rows]) + "\n")
    assert run("filter", tmp_path / "sorted.csv", "--model", model, "--out", tmp_path / "whole.csv", "--quiet")[0] == 0
    os.mkfifo(tmp_path / "pipe")
    text = "\n".join([head, *rows[:50], "0.1,lidar,1,2,3" + "," * 9, *rows[50:]]) + "\n"
    writer = threading.Thread(target=(tmp_path / "pipe").write_text, args=(text,))
    writer.start()
    code, out, error = run("filter", "--follow", tmp_path / "pipe", "--model", model, "--out", tmp_path / "live.csv")
    writer.join()
    assert code == 0
    assert "pipe:52: no sensor 'lidar' in model slow" in error
    assert f"{len(rows)} observations" in out
    assert "1 row left out" in out

    def body(name):
        return [line for line in (tmp_path / name).read_text().splitlines() if line[0] != "#"]

    assert body("live.csv") == body("whole.csv")


def test_a_quaternion_beyond_all_lengths_has_no_reading():
    assert attitude_note(("star", 0.0, np.full(4, 1e200)), relnav.load_model("rendezvous_demo")) == ""
