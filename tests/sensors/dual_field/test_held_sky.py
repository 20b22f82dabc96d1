"""27 frames of other cameras, 5 to 20 deg wide, only the focal length roughly known: how many, and none wrong."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from relnav.files.star_frames import StarFrame
from relnav.files.star_solving import solve_frame

FOLDER = Path(__file__).parents[2] / "data" / "held_sky"
REFERENCE = json.loads((FOLDER / "reference.json").read_text())
UNSOLVED = {"science_cam_1", "science_cam_7"}
"""Six of their hundred spots or fewer are stars of the catalogue."""


@pytest.fixture(scope="module")
def frames():
    """Name -> the frame."""
    rows = {}
    with (FOLDER / "frames.csv").open() as file:
        for row in csv.DictReader(file):
            rows.setdefault(row["frame"], []).append([float(row[key]) for key in ("x_px", "y_px", "flux")])
    tables = {name: np.array(table) for name, table in rows.items()}
    return {name: StarFrame(Path(name), table[:, :2], table[:, 2], None) for name, table in tables.items()}


def check(name, solution, outside=None):
    """A solution agrees with the independent solver's, or with the camera's calibration."""
    expected = REFERENCE[name]
    assert solution.focal_length_px == pytest.approx(expected["focal_px"], rel=5e-3)
    if "tetra3rs" in expected:
        ra, dec = np.radians([expected["tetra3rs"]["ra_deg"], expected["tetra3rs"]["dec_deg"]])
        other = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
        off_px = np.linalg.norm(solution.dcm_cam_from_icrs[2] - other) * expected["focal_px"]
        assert off_px < 1.5
        if outside is not None:
            outside("tetra3rs 0.14.0 on pictures of other cameras", f"direction of {name}'s centre, px", off_px, 1.5)


@pytest.mark.parametrize("name", sorted(set(REFERENCE) - UNSOLVED))
def test_solved(frames, name, outside):
    solution = solve_frame(frames[name], None, 1.03 * REFERENCE[name]["focal_px"])
    assert solution.ok, solution.reason
    check(name, solution, outside)


@pytest.mark.parametrize("name", ["orion_belt", "hale_bopp", "science_cam_3"])
def test_solved_with_a_focal_length_known_to_30_percent(frames, name):
    for factor in (0.8, 1.28):
        solution = solve_frame(frames[name], None, factor * REFERENCE[name]["focal_px"], focal_error=0.3)
        assert solution.ok, solution.reason
        check(name, solution)


def test_there_are_27():
    assert len(REFERENCE) == 27
    assert len(UNSOLVED) == 2
