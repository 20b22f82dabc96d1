"""The long-run filter of a mission at one geometry: what `steady_state` says of the beacons seen from there."""

import numpy as np

from relnav.arrays import Flags, Matrix, Vector, vector
from relnav.dynamics.clohessy_wiltshire import transition
from relnav.dynamics.error_state import MOTION
from relnav.dynamics.process_noise import acceleration_noise
from relnav.estimation.steady_state import SteadyState, steady_state
from relnav.mission import Model
from relnav.navigation.arguments import choose
from relnav.navigation.memory import Memory, views
from relnav.navigation.observation.beacon_geometry import locate
from relnav.navigation.observation.beacon_rows import observe
from relnav.navigation.observation.measurement_matrices import rows_in_use
from relnav.sensors.measurement import Status


def settled_filter(
    model: Model, position_dock_m: Vector, rate_hz: float, method: str = "fix", beacons: str = "abc"
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
    m = views(choose(model, method, None, "compiled"))
    lever = model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
    place = model.dcm_dock_from_lvlh.T @ vector("position_dock_m", position_dock_m, (3,))
    seen = np.array([name in beacons for name in "abcdefghijklmnopqrstuvwxyz"[: len(model.beacons_lvlh_m)]])
    h, r, reason = rows_at(model, m, model.port_position_m + place - lever, seen)
    if len(h) == 0:
        raise ValueError(
            f"no measurement at {np.asarray(position_dock_m).tolist()} m in the docking frame ({reason.name})"
        )
    n = model.orbit.mean_motion_rad_s
    q = acceleration_noise(n, 1.0 / rate_hz, model.process_noise.acceleration_noise_density_m2_s3)
    return steady_state(transition(n, 1.0 / rate_hz), q, h, r)


def rows_at(model: Model, m: Memory, position_m: Vector, seen: Flags) -> tuple[Matrix, Matrix, Status]:
    """H (k, 6) and R (k, k) of an image without noise from a position (3,), `lvlh_ccsds`; k = 0: no measurement, why.

    The camera holds the model's attitude; seen (beacons,) says which beacons it sees.
    """
    m.track["state"][:3] = position_m
    c = (model.beacons_lvlh_m - position_m) @ model.dcm_cam_from_lvlh.T - model.camera_lever_cam_m
    spots = np.where(seen[:, None], model.sensor.focal_length_m * c[:, :2] / c[:, 2:], np.nan)
    locate(m, m.track)
    _, usable, reason = observe(m, m.track["state"], spots)
    if usable == 0:
        return np.empty((0, MOTION)), np.empty((0, 0)), Status(reason)
    h, _, r, _ = rows_in_use(m)
    return h, r, Status(reason)
