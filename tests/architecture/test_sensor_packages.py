"""One shape for all sensor systems: whoever knows one knows where to look in the next."""

import inspect
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import relnav

FOLDER = Path(relnav.__file__).parent / "sensors"
SYSTEMS = sorted(path.name for path in FOLDER.iterdir() if (path / "__init__.py").is_file())


def test_the_five_systems():
    assert SYSTEMS == ["aps_sun", "birefringent_sun", "dual_field", "three_beacon", "three_marker"]
    assert set(SYSTEMS) <= set(relnav.__all__)


def test_none_imports_another(root):
    """The rule of `pyproject.toml` names them all."""
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (independent,) = [contract["modules"] for contract in contracts if contract["type"] == "independence"]
    assert sorted(independent) == [f"relnav.sensors.{name}" for name in SYSTEMS]


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_was_built_and_its_measurement(name):
    """`sensor.py` holds what was built, `measure.py` the function; the package exports both."""
    package = import_module(f"relnav.sensors.{name}")
    assert (FOLDER / name / "sensor.py").is_file()
    assert (FOLDER / name / "measure.py").is_file()
    assert inspect.isfunction(package.measure)
    assert package.measure.__module__ == f"{package.__name__}.measure"
    homes = {getattr(package, export).__module__ for export in package.__all__ if export[0].isupper()}
    assert f"{package.__name__}.sensor" in homes


@pytest.mark.parametrize("name", SYSTEMS)
def test_the_face_of_the_package(name):
    """What the system is in one line, its source, and sorted names, each from below and with a docstring."""
    package = import_module(f"relnav.sensors.{name}")
    first, empty, source = package.__doc__.splitlines()[:3]
    assert ": " in first
    assert first.endswith(".")
    assert (empty, source.partition(" ")[0]) == ("", "Source:")
    assert package.__all__ == sorted(package.__all__)
    assert "measure" in package.__all__
    for export in package.__all__:
        value = getattr(package, export)
        assert value.__doc__, export
        assert value.__module__.startswith("relnav.sensors."), export


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_was_seen_then_the_model(name):
    """`measure(seen, model, *, ...)`: what may be left out is given by name alone."""
    seen, model, *others = inspect.signature(import_module(f"relnav.sensors.{name}").measure).parameters.values()
    assert seen.name in ("spots_m", "spots_px", "seen")
    assert model.name == "model"
    assert [
        other.name for other in others if other.kind is not other.KEYWORD_ONLY or other.default is other.empty
    ] == []
