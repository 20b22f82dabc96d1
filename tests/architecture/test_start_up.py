"""Start-up: `import relnav` and `relnav --help` are instant because they load nothing heavy."""

import json
import os

import pytest

HEAVY = ["numpy", "numba", "scipy", "matplotlib", "filterpy", "control", "pydantic", "pyarrow"]
REPORT = "; import sys, json; print(); print(json.dumps([name for name in {heavy!r} if name in sys.modules]))"


def loaded(python, code, heavy=HEAVY):
    done = python(code + REPORT.format(heavy=heavy))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_import_relnav_loads_nothing_heavy(python):
    assert loaded(python, "import relnav; relnav.__all__; dir(relnav)") == []


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["filter", "--help"], ["models"]])
def test_help_loads_nothing_heavy(python, arguments):
    assert loaded(python, f"import relnav.cli; assert relnav.cli.run({arguments!r}) == 0") == []


FIRST = {
    "beacons": "n = relnav.Navigator(relnav.load_model('three_beacon_psd')); "
    "[n.step(0.1 * k, [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]]).covariance for k in range(3)]",
    "markers": "n = relnav.PoseNavigator(relnav.load_model('three_marker_vision')); "
    "[n.step(0.1 * k, [[459.0, 532.0], [562.0, 531.0], [511.0, 478.0]]).docking for k in range(3)]",
}


@pytest.mark.parametrize("name", FIRST)
def test_a_first_estimate_needs_neither_scipy_nor_filterpy(python, name):
    """Each of them takes as long to import as all the rest; numba is not imported where code is at hand."""
    code = f"import relnav; {FIRST[name]}" + REPORT.format(heavy=["scipy", "filterpy", "control", "pyarrow"])
    done = python(code, environment={"RELNAV_JIT": "0"})
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []


STAR_FRAME = """
from relnav.sensors.dual_field.blind import Blind, solve_blind
catalogue = relnav.load_model("ground_camera").catalogue
v = catalogue.directions(2020.0)
v = v[v[:, 2] > 0.97][:30]
assert solve_blind(Blind(2000.0 * v[:, :2] / v[:, 2:], None, 2000.0), catalogue, 2020.0).ok"""


@pytest.mark.parametrize("name", [*FIRST, "star frame of unknown focal length"])
def test_with_code_at_hand_it_does_not_import_numba(python, name):
    """What was compiled by one process is enough for the next."""
    if os.environ.get("RELNAV_JIT") == "0":
        pytest.skip("RELNAV_JIT=0 in this run: nothing is compiled")
    code = f"import relnav; {FIRST.get(name, STAR_FRAME)}" + REPORT.format(heavy=["numba"])
    last = [python(code) for _ in range(2)][-1]
    assert last.returncode == 0, last.stderr
    assert json.loads(last.stdout.splitlines()[-1]) == []
    assert last.stderr == ""


def test_the_check_can_fail(python):
    assert loaded(python, "import relnav; relnav.Navigator") != []


def test_filter_loads_no_second_filter_and_no_plotting(python, root, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("".join((root / "examples/basilisk_approach/vbar_log.csv").read_text().splitlines(True)[:30]))
    arguments = ["filter", str(log), "--model", "three_beacon_psd", "--out", str(tmp_path / "track.csv")]
    code = f"import relnav.cli; assert relnav.cli.run({arguments!r}) == 0"
    assert loaded(python, code, ["filterpy", "control", "matplotlib", "pandas", "pyarrow"]) == []
