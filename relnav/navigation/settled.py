"""The long-run filter of a mission at one geometry: what `steady_state` says of the beacons seen from there."""

import numpy as np

from relnav.arrays import Vector
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.steady_state import SteadyState, steady_state
from relnav.mission import Model
from relnav.navigation.block import R_FACTOR, VARIANCE, H, new_block
from relnav.navigation.observation import linearise, prepare
from relnav.navigation.sight import beacon_in_camera, uses_coordinates
from relnav.sensors.measurement import Status


def settled_filter(
    model: Model, position_dock_m: Vector, rate_hz: float, method: str = "spots", beacons: str = "abc"
) -> SteadyState:
    """Steady state of the filter while the camera holds a position.

    Parameters
    ----------
    model : Model
        Mission; its attitude is held.
    position_dock_m : (3,)
        Camera in the docking frame.
    rate_hz : float
        Images a second.
    method : {"spots", "fix"}
        Measurement model.
    beacons : str
        Which are seen: "abc", "c", ...

    Raises
    ------
    ValueError
        If the geometry gives no measurement (a beacon behind the camera, a fix outside its domain).
    """
    block = new_block(model, method, model.sensor.projection)
    lever = model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
    x = np.zeros(6)
    x[:3] = model.port_position_m + model.dcm_dock_from_lvlh.T @ np.asarray(position_dock_m, dtype=np.float64) - lever
    spots, c = np.full((3, 2), np.nan), np.empty(3)
    for i, name in enumerate("abc"):
        if name in beacons:
            beacon_in_camera(block, x, i, c)
            spots[i] = model.sensor.focal_length_m * c[:2] / c[2]
    _, usable, reason = prepare(block, x, spots)
    if usable == 0 or not linearise(block, x, spots):
        raise ValueError(
            f"no measurement at {np.asarray(position_dock_m).tolist()} m in the docking frame ({Status(reason).name})"
        )
    rows = np.flatnonzero(block[VARIANCE] > 0.0)
    r = np.diag(block[VARIANCE, rows])
    if not uses_coordinates(block):
        lower = np.tril(block[R_FACTOR : R_FACTOR + 3, :3], -1)[: len(rows), : len(rows)] + np.eye(len(rows))
        r = lower @ r @ lower.T
    n = model.orbit.mean_motion_rad_s
    q = acceleration_noise(n, 1.0 / rate_hz, model.process_noise.acceleration_noise_density_m2_s3)
    return steady_state(transition(n, 1.0 / rate_hz), q, block[H : H + 6][rows].copy(), r)
