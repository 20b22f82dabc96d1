"""What a type checker, and so an editor, tells a user of the public names: mypy on a program outside the package."""

import re
import typing

import pytest

import relnav

PROGRAM = """
from pathlib import Path
import relnav

beacons, markers = relnav.load_model("three_beacon_psd"), relnav.load_model("three_marker_vision")
reveal_type(beacons)
reveal_type(markers)
reveal_type(relnav.load_model("dual_field_star", {"detector_width_px": 512}))
reveal_type(relnav.load_model("aps_sun"))
reveal_type(relnav.load_model("birefringent_sun"))
reveal_type(relnav.load_model("my_model.toml"))
reveal_type(relnav.load_model(Path("my_model.toml")))
reveal_type(relnav.filter_log("x.csv", beacons, method="fix", smooth=True))
reveal_type(relnav.filter_log("x.csv", "three_beacon_psd_rbar"))
reveal_type(relnav.filter_log("x.csv", markers, smooth=True))
reveal_type(relnav.filter_log("x.csv", "three_marker_vision_flat"))
reveal_type(relnav.filter_log("x.csv", "my_model.toml"))
mine: relnav.Model = relnav.load_model("my_model.toml")
reveal_type(relnav.filter_log("x.csv", mine))
relnav.Navigator(markers)
relnav.filter_logs
"""

REVEALED = [
    "relnav.mission.Model",
    "relnav.mission.VisionMission",
    "relnav.sensors.dual_field.sensor.StarSensor",
    "relnav.sensors.aps_sun.sensor.ApsSunModel",
    "relnav.sensors.birefringent_sun.sensor.BirefringentSunModel",
    "Any",
    "Any",
    "relnav.navigation.record.Solution",
    "relnav.navigation.record.Solution",
    "relnav.navigation.pose_record.PoseSolution",
    "relnav.navigation.pose_record.PoseSolution",
    "Any",
    "relnav.navigation.record.Solution",
]


def test_a_users_program(tool, tmp_path, monkeypatch, root):
    """Classes are known without an annotation; misuse and misspelling are errors, two in all."""
    monkeypatch.setenv("MYPYPATH", str(root))
    (tmp_path / "program.py").write_text(PROGRAM)
    done = tool("mypy", "--strict", "--no-pretty", str(tmp_path / "program.py"))  # in the cache of the package's check
    assert re.findall(r'Revealed type is "(.*)"', done.stdout) == REVEALED, done.stdout + done.stderr
    errors = re.findall(r" error: (.*)", done.stdout)
    assert len(errors) == 2, done.stdout
    assert 'incompatible type "VisionMission"; expected "Model"' in errors[0]
    assert 'Module has no attribute "filter_logs"' in errors[1]


@pytest.mark.parametrize("name", relnav.list_models())
def test_every_shipped_name_is_typed_as_what_is_loaded(name):
    """A new folder under models/ needs its name in an overload of `load_model`."""
    told = []
    for choice in typing.get_overloads(relnav.load_model):
        names, cls = choice.__annotations__["name_or_path"], choice.__annotations__["return"]
        if name in typing.get_args(names):
            told.append(cls if isinstance(cls, str) else cls.__name__)
    assert told == [type(relnav.load_model(name)).__name__]
