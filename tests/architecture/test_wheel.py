"""What is shipped: the wheel holds the package and its models, nothing else, and does the main job on its own."""

import os
import re
import subprocess
import sys
import tarfile
import zipfile

import pytest


@pytest.fixture(scope="module")
def wheel(distributions):
    (path,) = distributions.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def names(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


@pytest.fixture(scope="module")
def unpacked(wheel, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def test_without_compiled_code_it_is_for_any_platform(wheel):
    assert wheel.name.endswith("-py3-none-any.whl")


def test_top_level_is_only_relnav(names):
    top = {name.partition("/")[0] for name in names}
    assert "relnav" in top
    assert {name for name in top if not name.endswith(".dist-info")} == {"relnav"}


def test_every_source_and_nothing_else(names, root, sources):
    inside = {name for name in names if name.startswith("relnav/") and not name.startswith("relnav/models/")}
    page = {str(path.relative_to(root)) for path in (root / "relnav/files/report").rglob("*") if path.is_file()}
    assert {"relnav/files/report/uplot/LICENSE", "relnav/files/report/page.js"} <= page
    expected = {str(path.relative_to(root)) for path in sources} | {"relnav/py.typed"} | page
    assert inside == expected


def test_models_are_inside_the_package(names, root):
    shipped = {name for name in names if name.startswith("relnav/models/")}
    expected = {
        f"relnav/models/{path.relative_to(root / 'models')}" for path in (root / "models").rglob("*") if path.is_file()
    }
    assert shipped == expected
    assert "relnav/models/three_beacon_psd/model.toml" in shipped
    assert "relnav/models/three_beacon_psd_rbar/published.toml" in shipped


def test_no_tests_and_no_caches(names):
    assert [name for name in names if "test" in name or "__pycache__" in name or "benchmark" in name] == []


def test_the_licence_and_the_command_are_declared(wheel, names):
    with zipfile.ZipFile(wheel) as archive:
        (entry_points,) = [name for name in names if name.endswith("entry_points.txt")]
        assert "relnav = relnav.__main__:main" in archive.read(entry_points).decode()
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_description_has_no_link_that_breaks_on_an_index(wheel, names, script):
    with zipfile.ZipFile(wheel) as archive:
        (entry,) = [name for name in names if name.endswith("/METADATA")]
        text = archive.read(entry).decode()
    assert "# relnav" in text
    assert "Classifier: Programming Language :: Python :: 3\n" in text
    assert re.findall(r"\]\((?!https?:|#)", text) == []
    said = script("hatch_build.py").for_an_index("![a](docs/a.png) [b](docs/b.md)", "https://host/us/relnav/")
    assert said == "![a](https://host/us/relnav/raw/HEAD/docs/a.png) [b](https://host/us/relnav/blob/HEAD/docs/b.md)"


def test_the_wheel_made_straight_from_the_checkout_is_the_same(root, names, tmp_path):
    command = [sys.executable, "-m", "build", "--no-isolation", "--wheel", "--outdir", str(tmp_path), str(root)]
    pure = os.environ | {"RELNAV_PREBUILD": "0"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=pure)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(path) as archive:
        assert sorted(archive.namelist()) == sorted(names)


def test_the_sdist_holds_what_it_takes_to_build_and_test(distributions):
    (path,) = distributions.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("pyproject.toml", "relnav/py.typed", "models/three_beacon_psd/model.toml", "LICENSE", "README.md"):
        assert name in inside
    assert any(name.startswith("tests/") for name in inside)
    assert "examples/basilisk_approach/vbar_log.csv" in inside
    assert [name for name in inside if "__pycache__" in name or name.startswith(".git/")] == []


MAIN_JOB = """
import sys
import relnav, relnav.cli
from relnav.files.model_folders import models_root
print(relnav.__file__)
print(models_root())
sys.exit(relnav.cli.run(sys.argv[1:]))
"""


def test_the_main_job_from_an_empty_folder(python, unpacked, root, tmp_path):
    """A copy of the example log, the wheel alone, nothing of the checkout at hand.

    As plain Python: compiling the unpacked wheel anew would take longer than all the rest.
    """
    log = (root / "examples" / "basilisk_approach" / "vbar_log.csv").read_bytes()
    empty = tmp_path / "empty"
    empty.mkdir()
    (empty / "approach.csv").write_bytes(log)
    done = python(
        MAIN_JOB,
        *("filter", "approach.csv", "--model", "three_beacon_psd", "--out", "track.csv"),
        path=unpacked,
        cwd=empty,
        environment={"RELNAV_JIT": "0"},
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    file, models, *summary = done.stdout.splitlines()
    assert file == str(unpacked / "relnav" / "__init__.py")
    assert models == str(unpacked / "relnav" / "models")
    assert "3000 epochs" in summary[0]
    rows = [line for line in (empty / "track.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(rows) == 3001
    assert sorted(path.name for path in empty.iterdir()) == ["approach.csv", "track.csv"]


def test_every_shipped_model_loads_from_the_wheel(python, unpacked, tmp_path):
    code = "import relnav; print(*relnav.list_models()); [relnav.load_model(name) for name in relnav.list_models()]"
    done = python(code, path=unpacked, cwd=tmp_path, environment={"RELNAV_JIT": "0"})
    assert done.returncode == 0, done.stderr
    assert "three_beacon_psd three_beacon_psd_rbar" in done.stdout
