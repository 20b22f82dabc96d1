"""A track in other frames: states and covariances turned together, with words that say what they are in.

With T the (6, 6) matrix of the turn, x' = T x + c and P' = T P T^T. Between frames that turn together (`lvlh_ccsds`,
`rsw`, `dock`) T is one rotation, for position and for velocity. Into inertial axes the velocity of the frame comes in:
with C = dcm_lvlh_from_eci and omega the frame's rate in its own axes,

    dr_eci = C^T dr,    dv_eci = C^T (dv + omega x dr).
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.dynamics.two_body import inertial_orbit
from relnav.errors import UsageError
from relnav.geometry.frames import DCM_LVLH_CCSDS_FROM_RSW
from relnav.mission import Orbit

FRAMES = {
    "lvlh_ccsds": "origin target's centre of mass, x V-bar, y = -h, z nadir; velocity in the turning frame",
    "rsw": "(= RTN = RIC = Hill) origin target's centre of mass, x radial out, y along-track, z = +h; velocity in the "
    "turning frame",
    "dock": "docking frame as the model holds it, origin O at the port, x out of it; velocity in the turning frame",
    "eci_relative": "chaser minus target in inertial axes, position and inertial velocity",
    "eci": "chaser in inertial axes from the Earth's centre; the target's orbit is taken as exact",
}
"""Name -> what it is."""
INERTIAL = ("eci_relative", "eci")


@dataclass(frozen=True)
class FramedTrack:
    """States and covariances of a track in a named frame, NaN where there is no state.

    Attributes
    ----------
    t_s : (n,)
        Times of the epochs.
    state : (n, 6)
        Position m and velocity m/s of the chaser's centre of mass.
    covariance : (n, 6, 6)
        Of `state`.
    frame : str
        One of `FRAMES`.
    metadata : dict
        What the frame is, the model, and, for inertial frames, the target's orbit.
    """

    t_s: Vector
    state: Matrix
    covariance: Stack
    frame: str
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def sigma(self) -> Matrix:
        """1-sigma of each component, (n, 6)."""
        sigma: Matrix = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return sigma

    def __len__(self) -> int:
        return len(self.t_s)

    def __repr__(self) -> str:
        """One line for the console."""
        return f"FramedTrack of {len(self)} epochs in {self.frame}: {FRAMES[self.frame]}"


def in_frame(
    solution: Any, frame: str, mission: Any, orientation_deg: tuple[float, float, float] | None = None
) -> FramedTrack:
    """A solution's states and covariances in another frame; `Solution.in_frame` describes it."""
    t, state = np.asarray(solution.t_s), np.asarray(solution.state)
    covariance = np.asarray(solution.covariance)[:, :6, :6]
    said = frame_words(frame, mission, orientation_deg) | {"model": str(solution.model)}
    shift: Any = np.zeros(6)
    if orientation_deg is not None and frame in INERTIAL:
        turn, target = _inertial(t, mission.orbit, orientation_deg)
        shift = target if frame == "eci" else shift
    else:
        dcm: Any = np.eye(3)
        if frame == "rsw":
            dcm = DCM_LVLH_CCSDS_FROM_RSW.T
        elif frame == "dock":
            dcm = mission.dcm_dock_from_lvlh
            shift = np.concatenate([-dcm @ mission.port_position_m, np.zeros(3)])
        turn = np.asarray(np.kron(np.eye(2), dcm)[None], dtype=np.float64)
    turned = np.einsum("nij,nj->ni", np.broadcast_to(turn, (len(t), 6, 6)), state) + shift
    turned_covariance = turn @ covariance @ np.swapaxes(turn, 1, 2)
    symmetric = 0.5 * (turned_covariance + np.swapaxes(turned_covariance, 1, 2))
    return FramedTrack(t, turned, symmetric, frame, said)


def frame_words(frame: str, mission: Any, orientation_deg: tuple[float, float, float] | None) -> dict[str, str]:
    """What there is to say of a frame, if all that it needs was given.

    Raises
    ------
    UsageError
        For an unknown frame, or one that needs what was not given.
    """
    if frame not in FRAMES:
        raise UsageError(f"frame is one of {', '.join(FRAMES)}; got {frame!r}")
    said = {"frame": f"{frame}: {FRAMES[frame]}"}
    if mission is None and frame in (*INERTIAL, "dock"):
        raise UsageError(f"frame {frame!r} needs the model that was flown, which is no shipped one: pass it")
    if frame not in INERTIAL:
        return said
    if orientation_deg is None or len(orientation_deg) != 3 or not np.all(np.isfinite(orientation_deg)):
        raise UsageError(
            f"frame {frame!r} needs the orientation of the target's orbit: inclination, right ascension of the "
            f"ascending node, argument of perigee, deg; got {orientation_deg!r}"
        )
    return said | {"target orbit": _orbit_words(mission.orbit, orientation_deg)}


def _inertial(t: Vector, orbit: Orbit, orientation_deg: tuple[float, float, float]) -> tuple[Stack, Matrix]:
    """Turns (n, 6, 6) from `lvlh_ccsds` into inertial axes, and the target's inertial states (n, 6)."""
    inclination, node, perigee = (math.radians(angle) for angle in orientation_deg)
    shape = orbit.mean_motion_rad_s, orbit.eccentricity, orbit.true_anomaly_rad
    r, v = inertial_orbit(*shape, (inclination, node, perigee), t)
    momentum = np.cross(r, v)
    size_h, size_r = np.linalg.norm(momentum, axis=1, keepdims=True), np.linalg.norm(r, axis=1, keepdims=True)
    y, z = -momentum / size_h, -r / size_r
    eci_from_lvlh = np.stack([np.cross(y, z), y, z], axis=2)
    rate = (size_h / size_r**2)[:, 0]  # about +h, which is -y of lvlh_ccsds
    cross = np.zeros((len(t), 3, 3))
    cross[:, 0, 2], cross[:, 2, 0] = -rate, rate
    turn = np.zeros((len(t), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = eci_from_lvlh
    turn[:, 3:, :3] = eci_from_lvlh @ cross
    return turn, np.concatenate([r, v], axis=1)


def lvlh_in_space(t_s: Vector, mission: Any, orientation_deg: tuple[float, float, float] | None) -> tuple[Stack, str]:
    """Rotations v_eci = dcm @ v_lvlh (n, 3, 3) at times (n,), and words for the orbit; errors as `frame_words`."""
    said = frame_words("eci_relative", mission, orientation_deg)
    assert orientation_deg is not None
    return _inertial(np.asarray(t_s), mission.orbit, orientation_deg)[0][:, :3, :3], said["target orbit"]


def _orbit_words(orbit: Orbit, orientation_deg: tuple[float, float, float]) -> str:
    inclination, node, perigee = orientation_deg
    return (
        f"two-body, mean motion {orbit.mean_motion_rad_s:.9g} rad/s, eccentricity {orbit.eccentricity:.9g}, true "
        f"anomaly {math.degrees(orbit.true_anomaly_rad):.9g} deg at t = 0, inclination {inclination:.9g} deg, right "
        f"ascension of the ascending node {node:.9g} deg, argument of perigee {perigee:.9g} deg"
    )
