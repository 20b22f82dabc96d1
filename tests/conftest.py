"""Independent truth for the tests: projections, rotations and derivatives written here with plain numpy.

Nothing in this file calls the product's geometry, so that a test that uses it can fail. The sensor is that of
Cai, Zhao, Sun, Qiao, Dai (1996), "Determination of target relative position and range by PSD optical sensor system".
"""

import importlib.util
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def module_of(place: str) -> ModuleType:
    """A script of the checkout, run as a module of its own."""
    spec = importlib.util.spec_from_file_location(Path(place).stem, ROOT / place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


raise_sites = module_of("tests/raise_sites.py")
raise_sites.watch()  # before anything of relnav is imported

from relnav.mission import Attitude, Camera, Docking, FilterSettings, Model, Orbit, ProcessNoise  # noqa: E402
from relnav.sensors.three_beacon import ThreeBeaconSensor  # noqa: E402

A_M = 0.3
B_M = math.sqrt(3.0) * A_M  # equilateral, Cai et al. (1996) section 1
F_M = 0.05
BEACONS_M = np.array([[0.0, A_M, 0.0], [0.0, -A_M, 0.0], [B_M, 0.0, 0.0]])
MEAN_MOTION_RAD_S = math.sqrt(3.986004418e14 / 6778137.0**3)


def position(range_m: float, azimuth_rad: float, elevation_rad: float) -> np.ndarray:
    """Cai et al. (1996) eq. (13) the other way round: elevation is positive toward -z."""
    level = range_m * math.cos(elevation_rad)
    return np.array([level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), -range_m * math.sin(elevation_rad)])


def angles(p: np.ndarray) -> np.ndarray:
    """(range, azimuth, elevation) by arcsine and complex argument, not by the product's arctangents."""
    r = float(np.linalg.norm(p))
    return np.array([r, float(np.angle(complex(p[0], p[1]))), -math.asin(p[2] / r)])


def look_at(p: np.ndarray, roll_rad: float = 0.0, tilt_rad: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """v_cam = dcm @ v_dock of a camera at p: boresight to O, then rolled about it, then tilted about x and y."""
    boresight = -p / np.linalg.norm(p)
    right = np.cross([0.0, 0.0, 1.0], boresight)
    right /= np.linalg.norm(right)
    dcm = np.array([right, np.cross(boresight, right), boresight])
    for axis, angle in ((2, roll_rad), (0, tilt_rad[0]), (1, tilt_rad[1])):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, s, -s, c
        dcm = turn @ dcm
    return dcm


def central(
    p: np.ndarray, dcm_cam_from_dock: np.ndarray, f: float = F_M, beacons: np.ndarray = BEACONS_M
) -> np.ndarray:
    """Spots (3, 2) that a real lens makes: f X/Z, f Y/Z."""
    spots = np.empty((3, 2))
    for i, beacon in enumerate(beacons):
        X, Y, Z = dcm_cam_from_dock @ (beacon - p)
        assert Z > 0.0, "the test put a beacon behind the camera"
        spots[i] = f * X / Z, f * Y / Z
    return spots


def parallel(p: np.ndarray, roll_rad: float = 0.0, f: float = F_M, beacons: np.ndarray = BEACONS_M) -> np.ndarray:
    """Spots (3, 2) of the projection of Cai et al. (1996): all beacons at the depth of O, the camera pointed at O."""
    dcm = look_at(p, roll_rad)
    return f / np.linalg.norm(p) * (beacons @ dcm.T)[:, :2]


def derivative(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float) -> np.ndarray:
    """Central differences with one Richardson extrapolation (error step^4), (size of function, size of x)."""
    x = np.asarray(x, dtype=np.float64)
    columns = []
    for i in range(x.size):
        slope = []
        for h in (step, 0.5 * step):
            d = np.zeros_like(x)
            d.flat[i] = h
            slope.append((np.ravel(function(x + d)) - np.ravel(function(x - d))) / (2.0 * h))
        columns.append((4.0 * slope[1] - slope[0]) / 3.0)
    return np.stack(columns, axis=-1)


def hill_matrix(n: float) -> np.ndarray:
    """System matrix (6, 6) of the equations of motion, lvlh_ccsds: x'' = 2n z', y'' = -n^2 y, z'' = 3n^2 z - 2n x'."""
    system = np.zeros((6, 6))
    system[:3, 3:] = np.eye(3)
    system[3, 5] = 2.0 * n
    system[4, 1] = -n * n
    system[5, 2] = 3.0 * n * n
    system[5, 3] = -2.0 * n
    return system


@pytest.fixture(scope="session")
def truth() -> SimpleNamespace:
    """The functions and constants of this file."""
    return SimpleNamespace(
        a=A_M, b=B_M, f=F_M, beacons=BEACONS_M, n=MEAN_MOTION_RAD_S, position=position, angles=angles,
        look_at=look_at, central=central, parallel=parallel, derivative=derivative, hill_matrix=hill_matrix,
    )  # fmt: skip


@pytest.fixture
def outside(record_property: Callable[[str, object], None]) -> Callable[..., None]:
    """outside(reference, what, difference, bound): held to the bound, and noted for `benchmarks/validation.py`.

    For an independent reference: a textbook, another program. `difference` is in the unit that `what` ends with.
    """

    def hold(reference: str, what: str, difference: float, bound: float) -> None:
        record_property("outside", (reference, what, float(difference), float(bound)))
        assert difference <= bound, f"{reference}: {what} differs by {difference}, more than {bound}"

    return hold


@pytest.fixture(scope="session")
def script() -> Callable[[str], ModuleType]:
    """script("benchmarks/mutation.py") -> that file as a module, made anew."""
    return module_of


@pytest.fixture(scope="session")
def derivatives() -> ModuleType:
    """What sensors measure, and derivatives derived of it: `tests/derivatives.py`."""
    return module_of("tests/derivatives.py")


@pytest.fixture(scope="session")
def messages() -> ModuleType:
    """`raise_sites.py`: what was triggered in this process so far."""
    return raise_sites


@pytest.fixture(scope="session")
def wide_sensor() -> ThreeBeaconSensor:
    """The sensor of Cai et al. (1996) with f a = 0.015 m^2 and a detector without edges."""
    return ThreeBeaconSensor(F_M, (10.0, 10.0), 10e-6, A_M, B_M)


@pytest.fixture(scope="session")
def sensor() -> ThreeBeaconSensor:
    """The same with the 8 mm detector of Table 1."""
    return ThreeBeaconSensor(F_M, (8e-3, 8e-3), 10e-6, A_M, B_M)


@pytest.fixture(scope="session")
def make_model(sensor: ThreeBeaconSensor) -> Callable[..., Model]:
    """A V-bar mission on a 400 km circular orbit, camera looking along -x; keywords replace its parts."""

    def make(**parts: object) -> Model:
        given = {
            "name": "test",
            "title": "test",
            "sensor": sensor,
            "docking": Docking(),
            "camera": Camera(),
            "attitude": Attitude("lvlh_hold", (0.5, -0.5, -0.5, -0.5)),
            "orbit": Orbit(MEAN_MOTION_RAD_S),
            "process_noise": ProcessNoise(1e-10),
            "filter": FilterSettings(0.1),
        }
        return Model(**{**given, **parts})  # type: ignore[arg-type]  # parts by name

    return make


def pytest_runtest_logreport(report):
    raise_sites.note_skip(report)


def pytest_collectreport(report):
    raise_sites.note_skip(report)


def pytest_deselected(items):
    raise_sites.left_out.update(item.nodeid for item in items)


def pytest_sessionfinish(session):
    """A whole run in which every test passes names the messages of the package that none of them triggered.

    It fails for them, unless tests were skipped, as what they need is not installed. RELNAV_MESSAGES=told in the
    environment leaves it at the names.
    RELNAV_MESSAGES=FILE.json in the environment keeps what any run triggered.
    """
    config, wish = session.config, os.environ.get("RELNAV_MESSAGES", "")
    if hasattr(config, "workeroutput"):
        config.workeroutput |= raise_sites.kept()
        return
    if wish.endswith(".json"):
        Path(wish).write_text(json.dumps(sorted(raise_sites.seen)), encoding="utf-8")
    by_default = config.args_source is config.ArgsSource.TESTPATHS
    if by_default and session.exitstatus == pytest.ExitCode.OK and raise_sites.is_whole(config.option):
        lines, fails = raise_sites.verdict()
        if lines:
            print("\n", *lines, sep="\n")
        if fails and wish != "told":
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """pytest-xdist: what a worker's tests have triggered, and which it skipped."""
    raise_sites.join(getattr(node, "workeroutput", {}))
