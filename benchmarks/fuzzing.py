"""Files made to break the readers and the filters: mutated where their structure is, not only bit by bit.

A case is a good file with some of its parts exchanged: names, cells, lines and bytes of a table; keys, values and lines
of a model; columns, types and bytes of Parquet; numbers of a log that is then filtered. What must hold: an error is one
of the documented kinds and one printable message that names the file; none takes 5 s of processor time; every number
of a track is finite where it has a state, and every covariance positive definite; memory stays below 1 GiB.

    python benchmarks/fuzzing.py [--cases 1000] [--target models] [--json FILE]

The test suite runs a few hundred of the same cases (tests/files/test_fuzzing.py).
"""

import argparse
import json
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import relnav
from relnav.errors import InputError, UsageError
from relnav.files.attitude_log import join_attitude, read_orbit, read_star_log
from relnav.files.logs import read_log
from relnav.files.model_folders import list_models, models_root
from relnav.files.models import load_model, load_published
from relnav.files.psd_calibration import read_calibration
from relnav.files.psd_grid import read_grid
from relnav.files.raw_logs import read_raw_log
from relnav.files.star_frames import read_star_frame
from relnav.files.sun_calibration import load_sun_calibration
from relnav.files.sun_measurements import read_sun_measurements

SLOWEST_S, MOST_BYTES = 5.0, 1 << 30
SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
CONTROL = "accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
BEACONS = [[-1500.0, 0.0, 1500.0, 0.0, 0.0, 0.0], [-1500.0, 3.0, 1500.0, 3.0, 0.0, 4.0]]
MARKERS = [[553.7, 553.7, 469.3, 553.7, 511.5, 511.5], [553.9, 553.5, 469.4, 553.6, 511.6, 511.5]]

NUMBERS = ["0", "-0.0", "nan", "inf", "-inf", "1e308", "-1e308", "5e-324", "1e20", "1e-20", "1e999", "0x10", "1_5", "٣"]
WORDS = ["", " ", '"', '""', '"a', "a,b", "#", "\x00", "\x1b[31m", "\r", "\u2028", "\ufeff", "é", "t_s", "=", "[", "]"]
CELLS = st.sampled_from(NUMBERS + WORDS) | st.floats().map(repr) | st.integers().map(str) | st.text(max_size=5)


def _join(path: Path) -> int:
    two = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    return join_attitude(path, np.array([0.0, 10.0]), two, path.with_name("joined.csv"))


TABLES: dict[str, tuple[Callable[[Path], Any], str, list[str]]] = {
    "beacon log": (read_log, SPOTS, ["0,-1500,0,1500,0,0,0", "1,-1500,0,1500,0,,"]),
    "raw log": (read_raw_log, "t_s,beacon,adc_x1,adc_x2,adc_y1,adc_y2", ["0,a,1,2,3,4", "1,dark,,2,3,4"]),
    "grid": (read_grid, "true_x_um,true_y_um,spot_x_um,spot_y_um", ["1,2,3,4", "5,6,,"]),
    "star frame": (read_star_frame, "x_px,y_px,flux", ["1,2,3", "-1,2,3"]),
    "star log": (read_star_log, "t_s,x_px,y_px,magnitude", ["0,1,2,3", "1,1,2,3"]),
    "orbit": (read_orbit, "t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s", ["0,6778,0,0,0,7.6,0"]),
    "joined log": (_join, SPOTS, ["0,-1500,0,1500,0,0,0", "1,-1500,0,1500,0,,"]),
    "sun table": (
        lambda path: read_sun_measurements(path, load_model("aps_sun")),
        "alpha_deg,beta_deg,spot_x_px,spot_y_px",
        ["0,0,512,512", "1,0,520,512"],
    ),
}


@st.composite
def texts(draw: Any, lines: list[str], separator: str) -> bytes:
    """Lines with pieces between separators exchanged, lines repeated, dropped and moved, bytes changed."""
    kept = list(lines)
    for _ in range(draw(st.integers(0, 4))):
        k = draw(st.integers(0, len(kept) - 1)) if kept else 0
        what = draw(st.sampled_from(["cell", "cell", "cell", "repeat", "drop", "insert", "swap"]))
        if what == "cell" and kept:
            pieces = kept[k].split(separator)
            pieces[draw(st.integers(0, len(pieces) - 1))] = draw(CELLS)
            kept[k] = separator.join(pieces)
        elif what == "repeat" and kept:
            kept[k:k] = [kept[k]] * draw(st.sampled_from([1, 2, 300]))
        elif what == "drop" and kept:
            del kept[k]
        elif what == "swap" and kept:
            kept.append(kept.pop(k))
        else:
            kept.insert(k, draw(CELLS))
    content = (
        draw(st.sampled_from(["\n", "\r\n", "\r"]))
        .join(kept)
        .encode(draw(st.sampled_from(["utf-8", "utf-8", "utf-8", "utf-8-sig", "utf-16"])), "surrogatepass")
    )
    return draw(changed_bytes(content)) if draw(st.booleans()) else content


@st.composite
def changed_bytes(draw: Any, content: bytes) -> bytes:
    """Some bytes exchanged, cut off or repeated."""
    data = bytearray(content)
    for _ in range(draw(st.integers(0, 4))):
        k = draw(st.integers(0, max(0, len(data) - 1)))
        what = draw(st.sampled_from(["set", "cut", "repeat"]))
        if what == "set" and data:
            data[k] = draw(st.integers(0, 255))
        elif what == "cut":
            del data[k : k + draw(st.integers(0, 40))]
        else:
            data[k:k] = data[k : k + 40] * draw(st.sampled_from([1, 50]))
    return bytes(data)


def parquets(folder: Path) -> st.SearchStrategy[bytes]:
    """Beacon logs in Parquet with columns of other types and names, some of their bytes changed."""
    import pyarrow
    from pyarrow import parquet

    kinds = [pyarrow.float64(), pyarrow.float32(), pyarrow.int8(), pyarrow.string(), pyarrow.bool_(), pyarrow.null()]
    names = SPOTS.split(",")

    @st.composite
    def build(draw: Any) -> bytes:
        columns, given_names = [], []
        for name in names:
            kind = draw(st.sampled_from([kinds[0]] * 12 + kinds))
            values = [draw(st.sampled_from([0.0, 1.0, None]))] * 3 if name != "t_s" else [0.0, 1.0, 2.0]
            columns.append(
                pyarrow.array(values).cast(pyarrow.float64()).cast(kind) if kind != kinds[-1] else [None] * 3
            )
            given_names.append(name if draw(st.integers(0, 15)) else draw(st.text(max_size=5)))
        table = pyarrow.table(columns, names=given_names)
        path = folder / "made.parquet"
        parquet.write_table(
            table.replace_schema_metadata({draw(st.binary(max_size=5)): draw(st.binary(max_size=9))}), path
        )
        content = path.read_bytes()
        return draw(changed_bytes(content)) if draw(st.booleans()) else content

    return build()


@st.composite
def flights(draw: Any, rows: list[list[float]], unit: str) -> bytes:
    """A log of twenty images in which times, spots and control are exchanged for what a number can be."""
    values = [[0.1 * k, *rows[k % 2], 0.0, 0.0, 0.0] for k in range(20)]
    size = st.sampled_from([0.0, 1e-300, 1e-9, 1.0, 1e3, 9e3, 1e10, 1e99, 1e308, -1.0, -9e3, -1e308, float("inf")])
    for _ in range(draw(st.integers(1, 6))):
        row, column = draw(st.integers(0, 19)), draw(st.integers(0, 9))
        values[row][column] = draw(size) if column else 0.1 * row + draw(st.sampled_from([1e-6, 0.05, -0.05, 1e9]))
    lines = [",".join("" if value == 1e99 else repr(value) for value in row) for row in values]
    return "\n".join([SPOTS.replace("_um", unit) + "," + CONTROL, *lines]).encode()


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


def targets(folder: Path) -> dict[str, tuple[str, Callable[[Path], Any], st.SearchStrategy[bytes]]]:
    """Name: ending of the file, what reads it, and the files."""
    found: dict[str, tuple[str, Callable[[Path], Any], st.SearchStrategy[bytes]]] = {}
    for name, (reader, header, rows) in TABLES.items():
        found[name] = ("log.csv", reader, texts(["# one = 1", header, *rows], ","))
    shipped = [(models_root() / name / "model.toml").read_text().splitlines() for name in list_models()]
    found["models"] = ("model.toml", load_model, st.sampled_from(shipped).flatmap(lambda text: texts(text, " ")))
    claims = (models_root() / "three_beacon_psd" / "published.toml").read_text().splitlines()
    (folder / "model.toml").write_bytes((models_root() / "three_beacon_psd" / "model.toml").read_bytes())
    found["published"] = (
        "published.toml",
        lambda path: load_published(path.with_name("model.toml")),
        texts(claims, " "),
    )
    psd = ["[calibration]", "order = 0", "center_um = [0.0, 0.0]", "half_width_um = [1.0, 1.0]"]
    psd += ["correction_x_um = [0.0]", "correction_y_um = [0.0]", "residual_sigma_um = 1.0", "rim_slope = 0.0"]
    psd += ["points = 100", "noise_sigma_um = 1.0"]
    found["detector calibration"] = ("c.toml", read_calibration, texts(psd, " "))
    axis = [float(k) for k in range(4)]
    sun = {"format": "relnav sun calibration 1", "method": "rays", "field_half_angle_deg": 50.0, "spot_noise_px": 0.1}
    sun |= {"calibration_noise_px": 0.1, "table": {"x_px": axis, "y_px": axis, "tangents": [[[0.0, 0.0]] * 4] * 4}}
    found["sun calibration"] = ("c.json", load_sun_calibration, texts(json.dumps(sun, indent=1).splitlines(), " "))
    found["parquet"] = ("log.parquet", read_log, parquets(folder))
    found["beacon track"] = ("log.csv", lambda path: check_track(path, "three_beacon_psd"), flights(BEACONS, "_um"))
    found["marker track"] = ("log.csv", lambda path: check_track(path, "three_marker_vision"), flights(MARKERS, "_px"))
    return found


def try_one(path: Path, read: Callable[[Path], Any], content: bytes) -> str:
    """Read one file; "read" or the kind of its error. AssertionError for everything that must not be."""
    path.write_bytes(content)
    for _ in range(2):  # again if it was slow: the first call of all compiles
        begin = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                read(path)
            outcome, message = "read", str(path)
        except (InputError, UsageError) as error:
            outcome, message = type(error).__name__, str(error)
        took = time.process_time() - begin
        if took < SLOWEST_S:
            break
    assert took < SLOWEST_S, "it takes too long"
    assert str(path) in message, f"a message does not name its file: {message}"
    assert len(message) < 30_000
    for line in message.split("\n"):
        assert line.isprintable(), f"a message holds what a terminal obeys: {line!r}"
    return outcome


def try_cases(strategy: Any, one: Callable[[Any], None], cases: int, *, derandomize: bool) -> None:
    """So many cases of a strategy; the first that must not be is raised, made small."""

    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        derandomize=derandomize,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(strategy)
    def each(case: Any) -> None:
        one(case)

    each()


def fuzz(name: str, folder: Path, cases: int, *, derandomize: bool = False) -> dict[str, Any]:
    """Try so many cases of one target; what came of them. The first that must not be is raised, made small."""
    ending, read, strategy = targets(folder)[name]
    outcomes: Counter[str] = Counter()

    def one(content: bytes) -> None:
        outcomes[try_one(folder / ending, read, content)] += 1

    try_cases(strategy, one, cases, derandomize=derandomize)
    return {"target": name, "cases": sum(outcomes.values()), "outcomes": dict(sorted(outcomes.items())), "faults": []}


def run_targets(
    about: str, fuzz_one: Callable[..., dict[str, Any]], names: Callable[[Path], Iterable[str]], word: str = "target"
) -> None:
    """The command line of a script that fuzzes: its targets one after another, what came of each, in JSON too."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--target", action="append")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for target in options.target or names(folder):
            try:
                entry = fuzz_one(target, folder, options.cases)
            except Exception as error:
                fault = "; ".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", [])])
                entry = {word: target, "cases": 0, "outcomes": {}, "faults": [fault]}
            used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            entry["memory_mib"] = used // 2**20
            if used > MOST_BYTES:
                entry["faults"].append("more than 1 GiB of memory")
            found.append(entry)
            print(json.dumps(entry), flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    sys.exit(any(entry["faults"] for entry in found))


if __name__ == "__main__":
    run_targets(__doc__ or "", fuzz, targets)
