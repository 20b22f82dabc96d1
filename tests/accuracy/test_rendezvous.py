"""The report on a vehicle: every row is there, and honest; who told what adds up."""

import dataclasses
import re

import pytest

import relnav
from relnav.accuracy.rendezvous import RANGES_M, measure
from relnav.simulation.rendezvous import Rendezvous

SLOW = {"gyro.rate_hz": 10.0, "sensor.star.rate_hz": 1.0, "sensor.psd.rate_hz": 1.0, "sensor.camera.rate_hz": 1.0}


@pytest.fixture(scope="module")
def report():
    vehicle = relnav.load_model("rendezvous_demo", changes=SLOW)
    near = dataclasses.replace(vehicle.hand_over, port_distance_m=(5.0, 0.0, 0.0), position_sigma_m=0.1)
    vehicle = dataclasses.replace(vehicle, hand_over=near)
    flight = Rendezvous(start_m=5.0, final_m=4.4, slow_m_s=0.1)
    steps = []
    made = measure(
        vehicle,
        relnav.load_published("rendezvous_demo"),
        runs=2,
        seed=3,
        progress=steps.append,
        flight=flight,
        short=flight,
    )
    assert steps == [1] * 6
    return made


def test_it_is_honest(report):
    assert report.ok
    rows = [row for row in report.rows if row.method.startswith("consistency")]
    assert len(rows) == 11 * (len(RANGES_M) + 1)
    assert all("NEES/n" in row.statistic for row in rows)


def test_a_row_for_each_sensor_left_out(report):
    lost = {row.method for row in report.rows if row.method.startswith("without")}
    names = ("gyro", "camera", "psd", "star", "sun_aps", "sun_birefringent")
    assert lost == {f"without {name}, from 5 m" for name in names}


def test_stars_tell_of_the_chaser_and_lights_of_the_rest(report):
    told = {}
    for note in report.notes:
        if match := re.match(r"(\w+): (\d+) % of the .* (\d+) % about the target's attitude, (\d+) %", note):
            told[match[1]] = [int(share) for share in match.groups()[1:]]
    for k in range(3):
        assert sum(shares[k] for shares in told.values()) == pytest.approx(100, abs=3)
    assert told["star"][2] > 80
    assert told["camera"][0] + told["psd"][0] > 95


def test_the_papers_figure_stands_beside(report):
    (row,) = [row for row in report.rows if row.method == "fused"]
    assert (row.quantity, row.published, row.unit) == ("range", 0.02, "m")
