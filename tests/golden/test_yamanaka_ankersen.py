"""Yamanaka-Ankersen's in-plane transition against Orekit's printed one."""

import math
import tomllib
from pathlib import Path

import numpy as np

from relnav.dynamics.yamanaka_ankersen import in_plane_change

CASE = tomllib.loads(Path(__file__).with_name("yamanaka_ankersen.toml").read_text())


def test_in_plane_transition(outside) -> None:
    e, (theta0, theta1) = CASE["eccentricity"], np.radians(CASE["true_anomaly_deg"])
    p = CASE["semi_major_axis_m"] * (1.0 - e * e)
    momentum = math.sqrt(CASE["mu_m3_s2"] * p)
    integral = momentum / p**2 * CASE["time_s"]  # J = k^2 t, k^2 = h / p^2
    S, V = math.sin(theta1 - theta0), 1.0 - math.cos(theta1 - theta0)
    W = integral - S / ((1.0 + e * math.cos(theta0)) * (1.0 + e * math.cos(theta1)))
    change = np.reshape(in_plane_change(e, math.sin(theta0), math.cos(theta0), S, V, W), (3, 3))
    got = np.eye(4)
    got[[0, 1, 3], 1:] += change
    got[2, 1:] += 2.0 * change[1]
    off = np.abs(got - CASE["in_plane"]).max()
    outside(CASE["authority"], "in-plane transition (8 digits printed)", off, CASE["absolute_tolerance"])
