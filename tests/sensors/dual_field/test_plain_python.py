"""The same lines as plain Python give the same attitude: compiled code adds speed, nothing else."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import relnav
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

CODE = """
import json, sys
import numpy as np
import relnav
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator
sensor = relnav.load_model("dual_field_star")
frame = StarFieldSimulator(sensor, SkyConditions()).frame(np.random.default_rng(1))
s = relnav.dual_field.measure(frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=(10.0, -20.0, 5.0))
print(json.dumps([s.dcm_cam_from_icrs.tolist(), s.covariance.tolist(), s.hip.tolist(), s.tried]))
"""


def test_compiled_is_plain(sensor):
    environment = os.environ | {"RELNAV_JIT": "0", "PYTHONPATH": str(Path(relnav.__file__).parents[1])}
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, check=False, env=environment, timeout=300
    )
    assert done.returncode == 0, done.stderr
    dcm, covariance, hip, tried = json.loads(done.stdout)
    frame = StarFieldSimulator(sensor, SkyConditions()).frame(np.random.default_rng(1))
    solution = relnav.dual_field.measure(
        frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=(10.0, -20.0, 5.0)
    )
    np.testing.assert_allclose(solution.dcm_cam_from_icrs, dcm, atol=1e-13)
    np.testing.assert_allclose(solution.covariance, covariance, rtol=1e-9)
    assert solution.hip.tolist() == hip
    assert solution.tried == tried == pytest.approx(tried)
