"""What the files' package refuses, and in which words: what no other of its tests triggers."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import relnav

ROOT = Path(__file__).parents[2]
PSD = relnav.load_model("three_beacon_psd")
VEHICLE = relnav.load_model("rendezvous_demo")
SPOTS = np.tile([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]], (3, 1, 1))


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def solved(*t_s):
    return relnav.filter_epochs(PSD, list(t_s or (0.0, 0.1, 0.2)), SPOTS)


def join(path):
    from relnav.files.attitude_log import join_attitude

    log = write(path / "log.csv", "t_s,q_cam_from_lvlh_x", "0,0")
    join_attitude(log, np.array([0.0, 1.0]), np.tile([0.0, 0.0, 0.0, 1.0], (2, 1)), path / "out.csv")


def join_one(path):
    from relnav.files.attitude_log import join_attitude

    join_attitude(path / "log.csv", np.array([0.0]), np.array([[0.0, 0.0, 0.0, 1.0]]), path / "out.csv")


def parquet(path, names, **columns):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    from pyarrow import Table, array
    from pyarrow.parquet import write_table

    table = Table.from_arrays([array(column) for column in columns.values()], names=names)
    write_table(table, path / "log.parquet", use_dictionary=False)
    return relnav.filter_log(path / "log.parquet", PSD)


def track(path, head, *rows):
    from relnav.files.track_file import TrackFile

    names = "t_s,x_m,y_m,z_m,sigma_x_m,nis,dof"
    file = TrackFile(write(path / "track.csv", *head, names, *rows))
    return list(file.parts())


def coded(path, name, code):
    from relnav.files.track_file import TrackFile

    text = write(path / "track.csv", f"t_s,x_m,y_m,z_m,sigma_x_m,nis,dof,{name}", f"0,1,1,1,1,1,3,{code}")
    return list(TrackFile(text).parts())


def star_table(path, kind, *rows):
    from relnav.files import attitude_log

    names = attitude_log.ORBIT_COLUMNS if kind == "orbit" else attitude_log.SPOT_COLUMNS
    return getattr(attitude_log, f"read_{kind}")(write(path / "table.csv", ",".join(names), *rows))


def sun_calibration(**changes):
    from relnav.files.sun_calibration import _patent

    content = {"limit_deg": 1, "radial": np.zeros((2, 3)).tolist(), "rows": np.zeros((2, 3, 4)).tolist()}
    return _patent(content | {"x0_px": 0.0, "y0_px": 0.0, "h_px": 1.0} | changes)


def sun(path, header):
    from relnav.files.sun_logs import read_sun_log

    return read_sun_log(write(path / "sun.csv", header, "0,0,1,1"), 1, 0.0)


def engine(name, which):
    from relnav.files import filter_file

    return getattr(filter_file, f"refuse_{which}")(name)


CALLS = {
    "join": (join, "column 'q_cam_from_lvlh_x' is there already; a log without attitudes is expected"),
    "join one": (join_one, "two or more solved star frames are needed"),
    "many columns": (
        lambda path: parquet(path, [f"c{i}" for i in range(10_001)], **{f"c{i}": [0.0] for i in range(10_001)}),
        "10001 columns; up to .* are read: leave out what is not needed",
    ),
    "no folder": (lambda _: relnav.campaign(PSD, 2, 1, cluster="local"), "needs a folder that all its workers see"),
    "close": (lambda p: relnav.write(solved(0.0, 1e-8, 2e-8), p / "t.oem", epoch="2026-07-02T12:00:00"),
              "rows less than a microsecond apart cannot be told apart in it"),
    "mcap": (lambda p: relnav.write(solved(-1.0, 0.0, 1.0), p / "t.mcap"), "times from 0 on; the log begins at -"),
    "raw engine": (lambda _: engine("filterpy", "raw"), "filters logs of spots, not raw ones of a detector"),
    "late engine": (lambda _: engine("filterpy", "late"), 'engine "filterpy" takes images at once: leave it out'),
    "frame": (lambda p: track(p, ["# frame = icrf"]), "a track in lvlh_ccsds is expected; its head says icrf"),
    "no rows": (lambda p: track(p, []), "no rows after the header; at least one epoch is expected"),
    "patent": (lambda _: sun_calibration(radial=[[0.0]]), "patent: radial .* do not fit limit_deg 1"),
    "patent nan": (lambda _: sun_calibration(h_px=1.0, radial=np.full((2, 3), np.nan).tolist()), "not a finite number"),
    "two times": (lambda p: sun(p, "spot_x_px,spot_y_px,t_s,t_ms"), "one column of times is expected, t_s"),
    "code": (lambda p: coded(p, "status", 99), "column 'status': a code, a whole number .*; got 99"),
    "no code": (lambda p: coded(p, "alarm", 0.5), "column 'alarm': a code, a whole number from 0 to .*; got 0.5"),
    "orbit": (lambda p: star_table(p, "orbit", "1,7000,0,0,0,7,0", "0,7000,0,0,0,7,0"), "times that increase"),
    "star log": (lambda p: star_table(p, "star_log", "1,0,0", "0,1,1"), "t_s goes back; sort the rows by time"),
    "corridor": (lambda _: solved().plot(corridor_deg=90.0), "corridor_deg is above 0 and up to 80; got 90.0"),
}  # fmt: skip


@pytest.mark.parametrize(("call", "message"), CALLS.values(), ids=CALLS)
def test_a_file_is_refused_in_these_words(call, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        call(tmp_path)


def vehicle(path):
    from relnav.files.vehicle_log import read_vehicle_log

    rows = (f"{0.1 * k},gyro,0,0,0" for k in range(3))
    return read_vehicle_log(write(path / "seen.csv", "t_s,sensor,v0,v1,v2", *rows), VEHICLE)


def raw(path, model=PSD, header="t_s,beacon,current_x1_na,current_x2_na,current_y1_na,current_y2_na"):
    rows = (f"{0.02 * k:.2f},{'abc'[k % 3]},1000,1000,1000,1000" + ",0" * (header.count(",") - 5) for k in range(6))
    return relnav.filter_log(write(path / "raw.csv", header, *rows), model)


def test_a_raw_log_of_more_beacons(tmp_path):
    sensor = dataclasses.replace(PSD.sensor, extra_beacons_m=((0.0, 0.5, 0.5),))
    with pytest.raises(relnav.ModelError, match="raw logs hold beacons a, b, c; the model lists more"):
        raw(tmp_path, dataclasses.replace(PSD, sensor=sensor))


def test_a_raw_log_that_lacks_a_column(tmp_path):
    header = "t_s,beacon,current_x1_na,current_x2_na,current_y1_na,current_y2_na,accel_x_m_s2,accel_y_m_s2"
    with pytest.raises(relnav.LogError, match="is missing; the others of its group are there"):
        raw(tmp_path, header=header)


@pytest.mark.parametrize(
    ("limit", "call", "message"),
    [
        ("relnav.files.vehicle_log.MOST_ROWS", vehicle, "more than 2 rows; split the log in time"),
        ("relnav.files.raw_logs.MOST_SLOTS", raw, "more than 2 slots; a raw log is held in memory: cut it in parts"),
    ],
)
def test_a_log_that_is_too_long(limit, call, message, tmp_path, monkeypatch):
    monkeypatch.setattr(limit, 2)
    with pytest.raises(relnav.LogError, match=message):
        call(tmp_path)


def test_a_few_kilobytes_that_unpack_to_much(tmp_path, monkeypatch):
    monkeypatch.setattr("relnav.files.parquet.BOMB_BYTES", 10_000)
    monkeypatch.setattr("relnav.files.parquet.BOMB_RATIO", 2)
    names = ["t_s", *(f"spot_{beacon}_{axis}_um" for beacon in "abc" for axis in "xy")]
    with pytest.raises(relnav.LogError, match=r"unpacks to \d+ bytes, from a file of \d+; no measured log does"):
        parquet(tmp_path, names, **{name: 0.0 + (np.arange(50_000) > 25_000) for name in names})


def test_a_parquet_log_that_is_damaged_inside(tmp_path):
    """Its head and foot are whole, its pages are not."""
    names = ["t_s", *(f"spot_{beacon}_{axis}_um" for beacon in "abc" for axis in "xy")]
    columns = {name: np.random.default_rng(1).normal(size=1000).cumsum() for name in names}
    columns["t_s"] = 0.1 * np.arange(1000.0)
    parquet(tmp_path, names, **columns)
    content = bytearray((tmp_path / "log.parquet").read_bytes())
    content[4:400] = bytes(396)
    (tmp_path / "log.parquet").write_bytes(content)
    with pytest.raises(relnav.LogError, match=r"damaged after row 0: "):
        relnav.filter_log(tmp_path / "log.parquet", PSD)


def test_a_calibration_of_the_other_sun_sensor(tmp_path):
    from relnav.files.sun_measuring import measure_sun

    with pytest.raises(relnav.UsageError, match="--calibration is for the APS sensor; a birefringent sensor's"):
        measure_sun(tmp_path / "pairs.csv", relnav.load_model("birefringent_sun"), calibration=object())


def test_a_table_that_is_read_whole():
    from relnav.files.logs import READ_WHOLE, read_csv

    with pytest.raises(relnav.LogError, match="more than 2 rows; a table of this kind is read whole: cut it in parts"):
        read_csv(ROOT / "examples" / "basilisk_approach" / "vbar_log.csv", most=(2, READ_WHOLE))


def test_no_scheduler_answers(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="distributed is not installed")
    monkeypatch.setattr("relnav.files.cluster.CONNECT_S", 1)
    with pytest.raises(relnav.UsageError, match=r"cluster tcp://127.0.0.1:9: no dask scheduler answers there"):
        relnav.campaign(PSD, 2, 1, out=tmp_path / "flights", cluster="tcp://127.0.0.1:9")


def test_a_picture_that_holds_no_numbers(monkeypatch):
    from relnav.files import sun_measuring

    monkeypatch.setattr(sun_measuring, "read_picture", lambda _: SimpleNamespace(counts=[[np.nan, 1.0]]))
    with pytest.raises(relnav.InputError, match=r"sun.fits: 1 pixels are no finite number"):
        sun_measuring.measure_sun(Path("sun.fits"), relnav.load_model("aps_sun"))


def test_pairs_of_spots_that_never_agree(monkeypatch):
    from relnav.files import sun_self_calibration as own

    turns = iter(np.arange(100) % 2 == 0)
    monkeypatch.setattr(own, "_agreement", lambda *_: (np.zeros((2, 2, 2)), np.zeros(2)))
    monkeypatch.setattr(own, "_agreeing", lambda *_: np.array([True, next(turns)]))
    monkeypatch.setattr(own, "self_calibrate", lambda *_, **__: SimpleNamespace(sensor=None))
    with pytest.raises(ValueError, match="which pairs of spots agree with the others does not settle"):
        own._settled(None, np.zeros((2, 2, 2)), ())


def test_runs_of_another_campaign(tmp_path):
    from relnav.files.campaign_page import write_campaign_page

    flown = SimpleNamespace(described={}, summary=None, runs=SimpleNamespace(failed=dict.popitem, folder=tmp_path))
    with pytest.raises(relnav.InputError, match=r"runs and campaign.json do not belong together"):
        write_campaign_page(flown, tmp_path / "page.html")


def test_what_spice_itself_refuses(tmp_path):
    pytest.importorskip("spiceypy", reason="spiceypy is not installed")
    from spiceypy.utils.exceptions import SpiceyError

    from relnav.files.spice import _kernel

    def full(*_):
        raise SpiceyError(short="SPICE(DASFULL)", long="The disk is full.")

    with pytest.raises(relnav.UsageError, match="SPICE refuses to write it"), _kernel(full, full, tmp_path, tmp_path):
        pass
