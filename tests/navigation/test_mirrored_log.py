"""What the page on troubleshooting says of a log in which y counts upward: the example approach, upside down."""

from pathlib import Path

import numpy as np
import pytest

import relnav

EXAMPLE = Path(__file__).parents[2] / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The first 60 s, every y of a spot with the other sign."""
    path = tmp_path_factory.mktemp("mirrored") / "log.csv"
    head, *rows = [line for line in EXAMPLE.read_text().splitlines() if not line.startswith("#")]
    upward = [name.startswith("spot_") and "_y_" in name for name in head.split(",")]
    cells = [
        [repr(-float(cell)) if turned and cell else cell for turned, cell in zip(upward, row.split(","), strict=True)]
        for row in rows[:600]
    ]
    path.write_text("\n".join([head, *(",".join(row) for row in cells)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("method", "alarm", "first_s"),
    [("fix", "CONTRADICTED", 35.1), ("spots", "SHIFTED", 14.8), ("spots", "RESTARTED", 15.4)],
)
def test_a_log_with_y_upward(log, method, alarm, first_s):
    """No image is called SWAPPED; the alarm comes when the page says."""
    flight = relnav.filter_log(log, relnav.load_model("three_beacon_psd"), method=method)
    raised = (flight.alarm & relnav.Alarm[alarm]) > 0
    assert flight.t_s[np.argmax(raised)] == pytest.approx(first_s, abs=0.05)
    assert not (flight.status == relnav.Status.SWAPPED).any()
    if method == "spots":
        assert not (flight.alarm & relnav.Alarm.CONTRADICTED).any()
        assert (flight.alarm[flight.t_s > 40.0] == 0).all()
