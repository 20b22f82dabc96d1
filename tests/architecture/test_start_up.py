"""Start-up: `import relnav` and `relnav --help` are instant because they load nothing heavy."""

import json

import pytest

HEAVY = ["numpy", "numba", "scipy", "matplotlib", "filterpy", "control", "pydantic", "pyarrow"]
REPORT = "; import sys, json; print(); print(json.dumps([name for name in {heavy!r} if name in sys.modules]))"


def loaded(python, code, heavy=HEAVY):
    done = python(code + REPORT.format(heavy=heavy))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_import_relnav_loads_nothing_heavy(python):
    assert loaded(python, "import relnav; relnav.__all__; dir(relnav)") == []


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["filter", "--help"], ["models", "--help"]])
def test_help_loads_nothing_heavy(python, arguments):
    assert loaded(python, f"import relnav.cli; assert relnav.cli.run({arguments!r}) == 0") == []


def test_the_check_can_fail(python):
    assert loaded(python, "import relnav; relnav.Navigator") != []


def test_filter_loads_no_second_filter_and_no_plotting(python, root, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("".join((root / "examples/basilisk_approach/vbar_log.csv").read_text().splitlines(True)[:30]))
    arguments = ["filter", str(log), "--model", "three_beacon_psd", "--out", str(tmp_path / "track.csv")]
    code = f"import relnav.cli; assert relnav.cli.run({arguments!r}) == 0"
    assert loaded(python, code, ["filterpy", "control", "matplotlib", "pandas", "pyarrow"]) == []
