"""The budget's lines for what lasts are what poses do whose camera and markers are built as badly as it says."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.three_marker_budget import budget
from relnav.estimation.consistency import chi_square_interval

RUNS = 400
RANGE_M = 3.0
NOTHING = {"attitude_sigma_rad": 0.0, "attitude_noise_rad": 0.0}


def measured(mission, focal, moved_m):
    """Place (3,) and attitude of the target in camera axes, of an image without noise; camera and markers are off."""
    camera, view = mission.camera, mission.view.dcm_cam_from_target
    p = (mission.markers.points_m + moved_m) @ view.T + [0.0, 0.0, RANGE_M]
    spots = (1.0 + focal) * np.array(camera.focal_length_px) * p[:, :2] / p[:, 2:] + camera.principal_point_px
    pose = relnav.three_marker.measure(spots, mission).pose
    turn = pose.dcm_cam_from_target @ view.T
    return pose.position_m, 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model("three_marker_vision")


@pytest.mark.parametrize("source", ["focal length", "marker placement"])
def test_a_line_is_the_scatter_of_poses(mission, source):
    rng, built = np.random.default_rng(6), mission.tolerances
    (row,) = budget(mission, (RANGE_M,)).rows
    tilt, roll, range_m, lateral = row.others[source]
    errors = []
    for _ in range(RUNS):
        focal, moved = 0.0, np.zeros((len(mission.markers.points_m), 3))
        if source == "focal length":
            focal = rng.normal() * built.focal_length_relative_sigma
        else:
            moved = rng.normal(size=moved.shape) * built.marker_placement_sigma_m
        place, turn = measured(mission, focal, moved)
        errors.append([*place - [0.0, 0.0, RANGE_M], *turn])
    scatter = np.array(errors).T @ np.array(errors) / RUNS
    lower, upper = chi_square_interval(RUNS, 0.9999)
    assert lower < scatter[2, 2] / range_m**2 < upper
    if source == "marker placement":
        assert lower < scatter[5, 5] / roll**2 < upper
        for part, sigma in ((slice(3, 5), tilt), (slice(0, 2), lateral)):
            worst = np.linalg.eigvalsh(scatter[part, part])[-1]
            assert lower < worst / sigma**2 < 1.1 * upper  # the larger of two alike is above either
    else:
        assert max(tilt, roll, lateral / RANGE_M) < 1e-9


def test_what_turns_all_about_the_lens(mission):
    for row in budget(mission, (2.0, 20.0)).rows:
        mount = mission.tolerances.camera_mounting_sigma_rad
        assert row.others["camera mounting"] == pytest.approx(mount * np.array([1.0, 1.0, 0.0, row.range_m]))
        noise = mission.chaser.attitude_noise_rad
        assert row.others["chaser attitude, one image"][0] == pytest.approx(noise)
        parts = [row.noise, *row.others.values()]
        assert row.total == pytest.approx(np.sqrt(np.sum(np.square(parts), axis=0)))


def test_a_camera_with_a_lens_that_distorts(mission):
    """A focal length off by a thousandth moves range and nothing else, as without distortion, on the boresight."""
    changes = {"camera.distortion": [-0.1, 0.02, 0.0, 0.0, 0.0]}
    (row,) = budget(relnav.load_model("three_marker_vision", changes=changes), (RANGE_M,)).rows
    (straight,) = budget(mission, (RANGE_M,)).rows
    assert row.others["focal length"][2] == pytest.approx(straight.others["focal length"][2], rel=0.02)
    assert row.others["marker placement"] == pytest.approx(straight.others["marker placement"], rel=0.02)


def test_the_command_prints_them(mission):
    lines = budget(mission).lines()
    assert any(line.startswith("  marker placement ") for line in lines)
    assert sum(line.startswith("  total ") for line in lines) == 4
    values = budget(mission).to_dict()["rows"][2]["others"]["camera mounting"]
    assert values[0] == mission.tolerances.camera_mounting_sigma_rad
    built = dataclasses.replace(mission, tolerances=None, chaser=dataclasses.replace(mission.chaser, **NOTHING))
    assert "no tolerances and no error of the chaser's attitude are stated: spot noise is all" in budget(built).lines()
