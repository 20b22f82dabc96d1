"""The package's own build: what it compiles goes into the wheel, and it can be told not to."""

import os
import sys
from types import SimpleNamespace

import pytest


@pytest.fixture
def build(root, script):
    """build(**options) -> the hook for a wheel, and hatchling's data of it."""
    module = script("hatch_build.py")

    def make(target="wheel", flights=("import this_and_that",)):
        module.FLIGHTS = dict.fromkeys(flights)
        hook = module.Prebuild(str(root), {}, SimpleNamespace(), SimpleNamespace(), str(root), target)
        return module, hook, {"force_include": {}}

    return make


def fly(module, monkeypatch, code):
    """Let every flight be this code."""
    real = module.subprocess.Popen
    monkeypatch.setattr(
        module.subprocess,
        "Popen",
        lambda command, **options: real([sys.executable, "-c", code, *command[2:]], **options),
    )


def test_what_the_flights_leave_goes_into_the_wheel(build, monkeypatch):
    module, hook, data = build(flights=("beacons", "markers"))
    monkeypatch.delenv("RELNAV_PREBUILD", raising=False)
    code = (
        "import os, sys, pathlib as p; f = p.Path(os.environ['NUMBA_CACHE_DIR']) / 'relnav_0'; "
        "f.mkdir(exist_ok=True); (f / (sys.argv[1] + '.code')).write_bytes(b''); (f / 'other.nbi').write_bytes(b'')"
    )
    fly(module, monkeypatch, code)
    hook.initialize("standard", data)
    assert sorted(data["force_include"].values()) == ["relnav/compiled/beacons.code", "relnav/compiled/markers.code"]
    assert (data["pure_python"], data["infer_tag"]) == (False, True)
    assert all(os.path.isfile(path) for path in data["force_include"])
    hook.finalize("standard", data, "")
    assert not any(os.path.exists(path) for path in data["force_include"])


def test_no_more_flights_at_once_than_processors(build, monkeypatch, tmp_path):
    """With three on two processors the longest would share its own with the others, and end last and alone."""
    module, hook, data = build(flights=("longest", "middle", "shortest"))
    monkeypatch.delenv("RELNAV_PREBUILD", raising=False)
    monkeypatch.setattr(module.os, "cpu_count", lambda: 1)
    log = tmp_path / "log"
    code = f"import sys; f = open({str(log)!r}, 'a'); [print(w, sys.argv[1], file=f, flush=True) for w in 'be']"
    fly(module, monkeypatch, code)
    hook.initialize("standard", data)
    hook.finalize("standard", data, "")
    expected = [f"{when} {name}" for name in ("longest", "middle", "shortest") for when in "be"]
    assert log.read_text().splitlines() == expected


def test_a_flight_that_fails_says_how_to_go_on(build, monkeypatch):
    module, hook, data = build()
    monkeypatch.delenv("RELNAV_PREBUILD", raising=False)
    fly(module, monkeypatch, "raise SystemExit(1)")
    with pytest.raises(RuntimeError, match="RELNAV_PREBUILD=0 builds without compiled code"):
        hook.initialize("standard", data)


@pytest.mark.parametrize(
    ("target", "version", "switch"),
    [("wheel", "standard", "0"), ("wheel", "editable", "1"), ("sdist", "standard", "1")],
)
def test_elsewhere_nothing_is_compiled(build, monkeypatch, target, version, switch):
    module, hook, data = build(target=target)
    monkeypatch.setenv("RELNAV_PREBUILD", switch)
    fly(module, monkeypatch, "raise SystemExit(1)")
    hook.initialize(version, data)
    hook.finalize(version, data, "")
    assert data == {"force_include": {}}


def test_its_flights_run(root, python):
    """As plain Python: what they compile is what a user's first minute needs, or they would be of no use."""
    for name in ("beacons", "markers"):
        done = python(
            f"import hatch_build; hatch_build.FLIGHTS[{name!r}]()", path=root, environment={"RELNAV_JIT": "0"}
        )
        assert done.returncode == 0, done.stderr
