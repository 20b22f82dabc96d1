"""A sixth sensor is a class and a line in the registry: its TOML then loads with units, sources and errors."""

from dataclasses import dataclass, field
from typing import Annotated

import pytest
from annotated_types import Gt

import relnav
from relnav.files.systems import SYSTEMS, System


@dataclass(frozen=True)
class Sextant:
    """A toy sensor."""

    arc_rad: Annotated[float, Gt(0.0)]
    arm_m: float
    readings: int = 1


@dataclass(frozen=True)
class Ship:
    """A toy mission."""

    name: str
    title: str
    sensor: Sextant
    provenance: dict = field(default_factory=dict)
    path: str = ""


TEXT = """
title = "A ship"
sensor_type = "sextant"

[sensor]
arc_deg = { value = 60.0, source = "paper", why = "Hadley 1731" }
arm_cm = 22
"""


@pytest.fixture
def registry(monkeypatch):
    monkeypatch.setitem(SYSTEMS, "sextant", System(mission=f"{__name__}:Ship"))


@pytest.fixture
def write(tmp_path):
    def run(text):
        folder = tmp_path / "victory"
        folder.mkdir(exist_ok=True)
        (folder / "model.toml").write_text(text)
        return folder

    return run


def test_its_model_loads_in_si(registry, write):  # noqa: ARG001  (the registry is changed)
    ship = relnav.load_model(write(TEXT))
    assert isinstance(ship, Ship)
    assert (ship.name, ship.title) == ("victory", "A ship")
    assert ship.sensor.arc_rad == pytest.approx(1.0471975511965976, rel=1e-15)
    assert ship.sensor.arm_m == 0.22
    assert ship.sensor.readings == 1
    assert ship.provenance["sensor.arc_deg"] == "paper: Hadley 1731"


def test_its_errors_are_told_the_same_way(registry, write):  # noqa: ARG001  (likewise)
    with pytest.raises(relnav.ModelError, match=r"model.toml:7: sensor.arm_deg: unit 'deg' does not fit; write one of"):
        relnav.load_model(write(TEXT.replace("arm_cm", "arm_deg")))
    with pytest.raises(relnav.ModelError, match=r"model.toml:6: sensor.arc_deg: .*greater than 0; got -60.0"):
        relnav.load_model(write(TEXT.replace("60.0", "-60.0")))


def test_without_the_line_it_is_unknown(write):
    with pytest.raises(relnav.ModelError, match=r"sensor_type: one of three_beacon.* is expected; got 'sextant'"):
        relnav.load_model(write(TEXT))


def test_a_filter_does_not_fly_it(registry, write):  # noqa: ARG001  (likewise)
    with pytest.raises(relnav.ModelError, match=r"model.toml: a relative navigation mission is expected .* a Ship"):
        relnav.filter_log("approach.csv", str(write(TEXT)), method="spots")
