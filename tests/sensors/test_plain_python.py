"""The same lines as plain Python give the same measurements: compiled code adds speed, nothing else."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import relnav

CODE = """
import json
import numpy as np
import relnav
from relnav.sensors.birefringent_sun.spots import project

def numbers_of(result):
    values = [getattr(result, name) for name in ("direction", "covariance", "position_m", "dcm_cam_from_target")
              if hasattr(result, name)]
    return [str(result.status), np.concatenate([np.ravel(value) for value in values]).tolist()]

def image(rows, places, rng):
    y, x = np.indices((rows, rows))
    counts = 20.0 + rng.normal(size=(rows, rows))
    for u, v in places:
        counts += 500.0 * np.exp(-0.5 * ((x - u) ** 2 + (y - v) ** 2) / 4.0)
    return np.clip(np.round(counts), 0.0, 1023.0)

def everything():
    rng, found = np.random.default_rng(5), []
    crystal, aps = relnav.load_model("birefringent_sun"), relnav.load_model("aps_sun")
    two = project(crystal.sensor, np.array([0.1, -0.2, np.sqrt(0.95)])) + 0.1 * rng.normal(size=(2, 2))
    for spots in (two, two[::-1], two + [[0.0, 0.0], [0.0, 30.0]]):
        found.append(relnav.birefringent_sun.measure(spots, crystal))
    found.append(relnav.birefringent_sun.measure(two, crystal, covariance_px2=0.01 * np.eye(4) + 0.002))
    corner = tuple(np.floor(two.mean(axis=0) - 60.0).tolist())
    found.append(relnav.birefringent_sun.measure(image(120, two - corner, rng), crystal, corner_px=corner))
    found.extend(relnav.aps_sun.measure(spot, aps) for spot in ([520.3, 500.1], [300.0, 700.0], [5.0, 5.0]))
    found.append(relnav.aps_sun.measure(image(24, [(11.3, 12.8)], rng), aps, corner_px=(400.0, 600.0)))
    for name in ("three_marker_vision", "three_marker_vision_flat"):
        model = relnav.load_model(name)
        points = model.markers.points_m @ model.view.dcm_cam_from_target.T + [0.3, -0.2, 8.0]
        spots = 511.5 + 1407.0 * points[:, :2] / points[:, 2:] + 0.1 * rng.normal(size=(len(points), 2))
        own = np.tile(0.02 * np.eye(2) + 0.005, (len(points), 1, 1))
        found.append(relnav.three_marker.measure(spots, model))
        found.append(relnav.three_marker.measure(spots[::-1], model, labelled=False))
        found.append(relnav.three_marker.measure(spots, model, spot_covariance_px2=own))
        prior = found[-1].roots[0].pose
        found.append(relnav.three_marker.measure(spots, model, prior=prior))
    return [numbers_of(result) for result in found]
"""


def test_compiled_is_plain():
    environment = os.environ | {"RELNAV_JIT": "0", "PYTHONPATH": str(Path(relnav.__file__).parents[1])}
    command = [sys.executable, "-c", CODE + "\nprint(json.dumps(everything()))"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    space: dict[str, object] = {}
    exec(CODE, space)
    compiled, plain = space["everything"](), json.loads(done.stdout)
    assert len(compiled) == 17
    assert sum(status == "0" for status, _ in compiled) >= 9
    for (status, values), (plain_status, plain_values) in zip(compiled, plain, strict=True):
        assert status == plain_status
        np.testing.assert_allclose(values, plain_values, rtol=1e-9, atol=1e-15 * np.nanmax(np.abs([*values, 0.0])))
