"""What reads files, each with the hostile files that it is given, and what must hold of what it read."""

import json
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fuzzing_bytes import BEACONS, MARKERS, SPOTS, changed_bytes, flights, parquets, pictures, texts
from fuzzing_choices import Choices

import relnav
from relnav.files.accuracy_page import read_report, write_accuracy_page
from relnav.files.attitude_log import join_attitude, read_orbit, read_star_log
from relnav.files.frame_logs import log_in_memory
from relnav.files.logs import opened, read_log
from relnav.files.model_folders import list_models, models_root
from relnav.files.models import load_model, load_published
from relnav.files.psd_calibration import read_calibration
from relnav.files.psd_grid import read_grid
from relnav.files.raw_logs import read_raw_log
from relnav.files.scenarios import load_scenario
from relnav.files.star_frames import read_star_frame
from relnav.files.star_pictures import see_picture
from relnav.files.sun_calibration import load_sun_calibration
from relnav.files.sun_logs import read_sun_log
from relnav.files.sun_measurements import read_sun_measurements
from relnav.files.track_file import TrackFile
from relnav.files.vehicle_log import filter_rows, read_vehicle_log

Maker = Callable[[Choices], bytes]
Target = tuple[str, Callable[[Path], Any], Maker]
"""Ending of the file (or its place in a folder), what reads it, and what makes its contents."""

VEHICLE = ["t_s,sensor," + ",".join(f"v{k}" for k in range(12))]
VEHICLE += ["0.0,gyro,1e-6,0.0011,-2e-6,,,,,,,,,", "0.05,star,0.5,-0.5,-0.5,-0.5,,,,,,,,"]
VEHICLE += ["0.1,sun_aps,0.0,0.0,1.0,1e-8,0,0,1e-8,0,0,,,", "0.2,psd,-0.0015,0,0.0015,0,0,0,,,,,,"]
VEHICLE += ["0.3,camera,553.7,553.7,469.3,553.7,511.5,511.5,,,,,,", "0.4,thrust,0,0,0.001,,,,,,,,,"]
"""A vehicle's log: a row of each kind of sensor."""
TRACK = ["t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,sigma_x_m,sigma_y_m,sigma_z_m,nis,dof,accepted,status"]
TRACK += [f"{0.1 * k:.1f},-10.0,0.1,0,0.03,0,0,0.01,0.01,0.01,1.5,6,3,2" for k in range(3)]
SCENARIO = ["[approach]", "duration_s = 30.0", "rate_hz = 2", "start_m = [10.0, 0.2, -0.1]", "speed_mm_s = 30"]
SCENARIO += ["j2 = false", "[spread]", "start_sigma_m = [0.1, 0.1, 0.1]", "[images]", "dropout = 0.1", "outliers = 0.0"]
SCENARIO += ['lost_beacon = "none"', "[as_built]", "by_tolerances = true", "[results]", "range_edges_m = [4.0, 6.0]"]
REPORT = {"model": "aps_sun", "ok": True, "runs": 10, "seed": 0, "notes": ["one"]}
REPORT["rows"] = [
    {"quantity": "alpha", "method": "fix", "range_m": 4.0, "published": 0.01, "measured": 0.009, "unit": "deg"}
    | {"statistic": "rms", "met": True, "expected": "met", "reason": "", "condition": ""}
]
REPORT["consistency"] = [
    {"method": "fix", "nees_mean": 6.0, "nees_inside_95": 0.95, "nis_per_dof": 1.0, "met": True, "expected": "met"}
]


def _join(path: Path) -> int:
    two = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    return join_attitude(path, np.array([0.0, 10.0]), two, path.with_name("joined.csv"))


def _look_at_track(path: Path) -> None:
    """Read a track as a page of it does."""
    from relnav.files.run_view import watcher_of

    track, watcher = TrackFile(opened(path)), watcher_of(None, 100)
    for part in track.parts():
        watcher.take_columns(part)
    watcher.view(path.name, "track", track.metadata)


def _look_at_report(path: Path) -> None:
    """Read an accuracy report, and write its page."""
    write_accuracy_page(read_report(path), path.with_name("page.html"))


@cache
def vehicle() -> Any:
    """The shipped vehicle."""
    return load_model("rendezvous_demo")


def _look_at_vehicle(path: Path) -> None:
    """Filter a vehicle's log: every estimate finite, its covariance positive definite."""
    flown = vehicle()
    for estimate in filter_rows(read_vehicle_log(path, flown), flown, refuse=lambda _error: None):
        assert np.isfinite(estimate.values).all(), "a state is finite"
        assert np.isfinite(estimate.covariance).all(), "a covariance is finite"
        assert (np.diagonal(estimate.covariance) >= 0.0).all(), "no variance is below zero"


TABLES: dict[str, tuple[Callable[[Path], Any], str, list[str]]] = {
    "beacon log": (read_log, SPOTS, ["0,-1500,0,1500,0,0,0", "1,-1500,0,1500,0,,"]),
    "raw log": (read_raw_log, "t_s,beacon,adc_x1,adc_x2,adc_y1,adc_y2", ["0,a,1,2,3,4", "1,dark,,2,3,4"]),
    "grid": (read_grid, "true_x_um,true_y_um,spot_x_um,spot_y_um", ["1,2,3,4", "5,6,,"]),
    "star frame": (read_star_frame, "x_px,y_px,flux", ["1,2,3", "-1,2,3"]),
    "star log": (read_star_log, "t_s,x_px,y_px,magnitude", ["0,1,2,3", "1,1,2,3"]),
    "orbit": (read_orbit, "t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s", ["0,6778,0,0,0,7.6,0"]),
    "joined log": (_join, SPOTS, ["0,-1500,0,1500,0,0,0", "1,-1500,0,1500,0,,"]),
    "sun log": (lambda path: read_sun_log(path, 1), "t_s,spot_x_px,spot_y_px", ["0,512,512", "1,520,512", "2,,"]),
    "vehicle log": (
        lambda path: read_vehicle_log(path, vehicle()),
        VEHICLE[0],
        VEHICLE[1:],
    ),
    "track": (_look_at_track, TRACK[0], TRACK[1:]),
}


def check_track(path: Path, model: str) -> None:
    """Filter a log, and hold every row of the track against what a track is."""
    mission = load_model(model)
    for smooth in (False, True):
        track = relnav.filter_log(path, mission, smooth=smooth)
        known = np.isfinite(track.state).all(axis=1)
        assert np.isnan(track.state[~known]).all(), "a state is known whole or not at all"
        covariance = track.covariance[known]
        assert np.isfinite(covariance).all()
        assert (np.diagonal(covariance, axis1=1, axis2=2) > 0.0).all(), "a variance is above zero"
        scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        correlation = covariance / scale[:, :, None] / scale[:, None, :]
        assert (np.linalg.eigvalsh(correlation) > -1e-9).all(), "a covariance is positive definite"


def lines(good: list[str], separator: str) -> Maker:
    """Texts of these lines with parts exchanged."""
    return partial(texts, lines=good, separator=separator)


def targets(folder: Path) -> dict[str, Target]:
    """Name: ending of the file, what reads it, and the files."""
    found: dict[str, Target] = {}
    for name, (reader, header, rows) in TABLES.items():
        found[name] = ("log.csv", reader, lines(["# one = 1", header, *rows], ","))
    shipped = [(models_root() / name / "model.toml").read_text().splitlines() for name in list_models()]
    found["models"] = ("model.toml", load_model, lambda choose: texts(choose, choose.one(shipped), " "))
    claims = (models_root() / "three_beacon_psd" / "published.toml").read_text().splitlines()
    (folder / "model.toml").write_bytes((models_root() / "three_beacon_psd" / "model.toml").read_bytes())
    found["published"] = (
        "published.toml",
        lambda path: load_published(path.with_name("model.toml")),
        lines(claims, " "),
    )
    psd = ["[calibration]", "order = 0", "center_um = [0.0, 0.0]", "half_width_um = [1.0, 1.0]"]
    psd += ["correction_x_um = [0.0]", "correction_y_um = [0.0]", "residual_sigma_um = 1.0", "rim_slope = 0.0"]
    psd += ["points = 100", "noise_sigma_um = 1.0"]
    found["detector calibration"] = ("c.toml", read_calibration, lines(psd, " "))
    axis = [float(k) for k in range(4)]
    sun = {"format": "relnav sun calibration 1", "method": "rays", "field_half_angle_deg": 50.0, "spot_noise_px": 0.1}
    sun |= {"calibration_noise_px": 0.1, "table": {"x_px": axis, "y_px": axis, "tangents": [[[0.0, 0.0]] * 4] * 4}}
    found["sun calibration"] = ("c.json", load_sun_calibration, lines(json.dumps(sun, indent=1).splitlines(), " "))
    found["parquet"] = ("log.parquet", read_log, parquets)
    found["beacon track"] = (
        "log.csv",
        lambda path: check_track(path, "three_beacon_psd"),
        partial(flights, rows=BEACONS, unit="_um"),
    )
    found["marker track"] = (
        "log.csv",
        lambda path: check_track(path, "three_marker_vision"),
        partial(flights, rows=MARKERS, unit="_px"),
    )
    for ending in (".png", ".tif", ".fits"):
        found[f"picture {ending}"] = (
            f"a{ending}",
            lambda path: see_picture(path, None, 5.0, None),
            partial(pictures, kind=ending),
        )
    found["sun table"] = ("sun.csv", lambda path: read_sun_measurements(path, load_model("aps_sun")), sun_tables())
    found["scenario"] = ("s.toml", load_scenario, lines(SCENARIO, " "))
    found["accuracy report"] = ("r.json", _look_at_report, lines(json.dumps(REPORT, indent=1).splitlines(), " "))
    found["vehicle track"] = ("log.csv", _look_at_vehicle, lines(VEHICLE, ","))
    return found | {name: in_folder(folder, file) for name, file in FOLDERS.items()}


def sun_tables() -> Maker:
    """Turntable angles and the spots that a pinhole of the sensor's size makes of them."""
    model = load_model("aps_sun")
    from relnav.sensors.aps_sun.rays import project

    angles = np.stack(np.meshgrid([-30.0, 0.0, 30.0], [-30.0, 0.0, 30.0], indexing="ij"), axis=-1).reshape(-1, 2)
    toward = np.column_stack([np.tan(np.radians(angles)), np.ones(9)])
    spots = project(model, toward / np.linalg.norm(toward, axis=1, keepdims=True))
    rows = [",".join(map(repr, row)) for row in np.column_stack([angles, spots]).tolist()]
    return lines(["alpha_deg,beta_deg,spot_x_px,spot_y_px", *rows], ",")


FOLDERS = {
    "ROS 2 bag, its description": "bag/metadata.yaml",
    "ROS 2 bag, its messages": "bag/bag.db3",
    "ROS 1 bag": "log.bag",
    "campaign, its description": "campaign/campaign.json",
    "campaign, its summary": "campaign/summary.json",
    "campaign, its runs": "campaign/runs/part-000000000000.parquet",
}
"""Targets that are a file of a folder, the others as they should be: made when the first of its cases is."""


def in_folder(folder: Path, file: str) -> Target:
    """A target of `FOLDERS`."""
    room = file.partition("/")[0]

    @cache
    def content() -> bytes:
        made = campaign_files() if room == "campaign" else bag_files()
        for place, whole in made.items():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            (folder / place).write_bytes(whole)
        return made[file]

    def contents(choose: Choices) -> bytes:
        if file.endswith((".json", ".yaml")):
            return texts(choose, content().decode().splitlines(), " ")
        return changed_bytes(choose, content())

    def read(_path: Path) -> None:
        if room == "campaign":
            from relnav.files.campaign_page import read_campaign, write_campaign_page

            write_campaign_page(read_campaign(folder / room), folder / "page.html")
        else:
            read_log(log_in_memory(folder / room) or folder / room)

    return file, read, contents


@cache
def campaign_files() -> dict[str, bytes]:
    """The files of a small campaign that was flown."""
    scenario = {"approach.duration_s": 4.0, "approach.rate_hz": 2.0, "results.settling_s": 1.0}
    with TemporaryDirectory() as name:
        out = Path(name) / "campaign"
        relnav.campaign("three_beacon_psd", 2, dispersions=load_scenario(None, scenario), out=out, workers=1)
        return {str(path.relative_to(name)): path.read_bytes() for path in out.rglob("*") if path.is_file()}


@cache
def bag_files() -> dict[str, bytes]:
    """A log of three images as bags of ROS 1 and ROS 2."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    kind, names = "sensor_msgs/msg/JointState", SPOTS.split(",")
    with TemporaryDirectory() as name:
        for module, path, store in (
            (rosbag1, "log.bag", get_typestore(Stores.ROS1_NOETIC)),
            (rosbag2, "bag", get_typestore(Stores.ROS2_HUMBLE)),
        ):
            time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
            number = {"seq": 0} if module is rosbag1 else {}
            options = {} if module is rosbag1 else {"version": 8}
            with module.Writer(Path(name) / path, **options) as writer:
                connection = writer.add_connection("/camera/spots", kind, typestore=store)
                pack = store.serialize_ros1 if module is rosbag1 else store.serialize_cdr
                for k in range(3):
                    head = header(stamp=time(k, 0), frame_id="camera", **number)
                    row, nothing = np.array([float(k), *BEACONS[k % 2]]), np.zeros(0)
                    writer.write(connection, k, pack(store.types[kind](head, names, row, nothing, nothing), kind))
        return {str(path.relative_to(name)): path.read_bytes() for path in Path(name).rglob("*") if path.is_file()}
