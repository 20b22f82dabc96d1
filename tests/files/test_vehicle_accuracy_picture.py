"""A picture of a vehicle's accuracy from a report of which every number is known."""

import numpy as np
import pytest

from relnav.accuracy.claims import information
from relnav.accuracy.rendezvous import VehicleReport
from relnav.files.vehicle_accuracy_picture import draw_vehicle_accuracy


def report():
    rows = []
    for range_m in (10.0, 1.0):
        for quantity, value in {"port along": 0.002, "port across": 0.001, "attitude": 0.01, "rate": 0.002}.items():
            for statistic, times in (("rms error an axis", 0.9), ("rms reported 1-sigma", 1.0)):
                place = (f"at {range_m:g} m", times * value * range_m, "m", statistic, range_m)
                rows.append(information(quantity, "all sensors, from 30 m", *place))
    for method, times in {"all sensors": 1.0, "without gyro": 3.0, "without camera": 2.0}.items():
        for quantity in ("port along", "port across", "attitude", "rate"):
            place = ("at 1 m", times * 0.001, "m", "rms reported 1-sigma", 1.0)
            rows.append(information(quantity, f"{method}, from 12 m", *place))
    shares = {"camera": np.array([0.75, 0.5, 0.0]), "star": np.array([0.25, 0.5, 1.0])}
    return VehicleReport("mine", 2, 7, tuple(rows), (), shares, {"thrust.scale": 0.05, "camera.mount": np.nan})


@pytest.mark.parametrize("ending", [".png", ".pdf", ".svg"])
def test_every_ending(tmp_path, ending):
    draw_vehicle_accuracy(report(), tmp_path / f"p{ending}")
    assert (tmp_path / f"p{ending}").stat().st_size > 5_000


def test_what_it_says(tmp_path):
    """Text of the picture: sensors, what is left, distances; what is considered is not among what could be seen."""
    draw_vehicle_accuracy(report(), tmp_path / "p.svg")
    text = (tmp_path / "p.svg").read_text()
    for said in (
        "mine: 2 approaches, seed 7",
        ">gyro<",
        ">camera<",
        ">thrust.scale<",
        ">5<",
        ">10<",
        "Sources of information",
    ):
        assert said in text
    assert "camera.mount" not in text
    assert "mathdefault" not in text


def test_as_plain_values():
    plain = report().to_dict()
    assert plain["shares_told"] == {"camera": [0.75, 0.5, 0.0], "star": [0.25, 0.5, 1.0]}
    assert plain["sigma_left"] == {"thrust.scale": 0.05, "camera.mount": None}
