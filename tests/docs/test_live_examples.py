"""The programs of examples/live: C++ through pipes, compiled here; the ROS 2 node without ROS; MATLAB's names exist."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

ROOT = Path(__file__).parents[2]
LIVE = ROOT / "examples" / "live"
LOG = ROOT / "examples" / "basilisk_approach" / "vbar_log.csv"


@pytest.mark.skipif(shutil.which("g++") is None, reason="no g++")
def test_cpp_reads_every_estimate(tmp_path):
    subprocess.run(
        ["g++", "-std=c++17", "-Wall", "-Werror", "-o", tmp_path / "follow", LIVE / "follow.cpp"], check=True
    )
    relnav_command = tmp_path / "relnav"
    relnav_command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m relnav "$@"\n')
    relnav_command.chmod(0o755)
    rows = "".join(LOG.read_text().splitlines(keepends=True)[:41])
    environment = os.environ | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "RELNAV_JIT": "0"}
    done = subprocess.run(
        [tmp_path / "follow"], input=rows, env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    (tmp_path / "log.csv").write_text(rows)
    solution = relnav.filter_log(tmp_path / "log.csv", "three_beacon_psd")
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
    expected = [
        f"{solution.t_s[e]:.1f} s: x {solution.state[e, 0]:.4f} m +- {solution.sigma[e, 0]:.4f} m, "
        f"closing at {-solution.state[e, 3]:.4f} m/s"
        for e in known
    ]
    assert done.stdout.splitlines() == expected
    assert done.stderr == ""


def test_the_node_gives_the_port_of_the_filter(script):
    node = script("examples/live/ros2_node.py")
    mission = relnav.load_model("three_marker_vision")
    flight = simulate_flight(mission, Approach(duration_s=4.0, rate_hz=5.0), seed=2)
    whole = filter_marker_epochs(mission, flight.t_s, flight.spots_px)
    estimator = node.Estimator("three_marker_vision")
    seen = 0
    for e, t in enumerate(flight.t_s):
        names = {f"spot_{'abc'[k]}_{'xy'[j]}_px": flight.spots_px[e, k, j] for k in range(3) for j in range(2)}
        found = estimator.step((int(t), round((t % 1.0) * 1e9)), names)
        if found is None:
            continue
        seen += 1
        position, turn, covariance = found
        np.testing.assert_allclose(position, whole.port_m[e], atol=1e-9)
        np.testing.assert_allclose(Rotation.from_quat(turn).as_matrix(), whole.dcm_target_from_chaser[e], atol=1e-9)
        np.testing.assert_allclose(
            np.reshape(covariance, (6, 6))[:3, :3], whole.docking_covariance[e, :3, :3], rtol=1e-6, atol=1e-15
        )
    assert seen > 10


def test_what_matlab_calls_is_there():
    text = (LIVE / "RelnavFilter.m").read_text()
    assert set(re.findall(r"py\.relnav\.(\w+)", text)) <= set(relnav.__all__)
    navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"), method="fix")
    record = navigator.step(0.0, np.full((3, 2), np.nan), acceleration_m_s2=np.zeros(3))
    assert set(re.findall(r"record\.(\w+)", text)) <= set(dir(record))
    assert np.asarray(record.covariance).shape == (6, 6)
