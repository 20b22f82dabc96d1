"""A track in other frames: states, attitudes and covariances turned together, with words that say what they are in.

With T the (6, 6) matrix of the turn, x' = T x + c and P' = T P T^T. Between frames that turn together (`lvlh_ccsds`,
`rsw`, `dock`) T is one rotation, for position and for velocity. Into inertial axes the velocity of the frame comes in:
with C = dcm_lvlh_from_eci and omega the frame's rate in its own axes,

    dr_eci = C^T dr,    dv_eci = C^T (dv + omega x dr).

An attitude of the target, dcm_lvlh_from_target exp([theta x]) when true, is multiplied from the left. Its error theta
and the target's inertial rate are in target axes, which no frame changes: their own covariance stays, and what they
have in common with position and velocity turns on the side of those.
"""

import math
from dataclasses import dataclass, field
from importlib import import_module
from textwrap import fill
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector, numbers
from relnav.dynamics.two_body import inertial_orbit
from relnav.errors import UsageError
from relnav.geometry.frames import DCM_LVLH_CCSDS_FROM_RSW
from relnav.geometry.rotation import quaternions_from_dcm_into

OWN = "lvlh_ccsds"
"""The frame in which the filters estimate."""
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
AXES = {"lvlh_ccsds": "lvlh", "rsw": "rsw", "dock": "dock", "eci_relative": "eci", "eci": "eci"}
"""Frame -> its axes, as names of quaternions have them: `q_rsw_from_target`."""


@dataclass(frozen=True)
class FramedTrack:
    """States, attitudes and covariances of a track in a named frame, NaN where there is no state.

    Attributes
    ----------
    t_s : (n,)
        Times of the epochs.
    state : (n, 6)
        Position m and velocity m/s of the chaser's centre of mass.
    covariance : (n, 6, 6), or (n, 12, 12) where an attitude is estimated
        Of `state`; of (`state`, theta rad, rate rad/s), the true attitude being dcm exp([theta x]), theta in target
        axes.
    frame : str
        One of `FRAMES`.
    metadata : dict
        What the frame is, the model, and, for inertial frames, the target's orbit.
    dcm_frame_from_target : (n, 3, 3), or None where no attitude is estimated
        Attitude of the target: v_frame = dcm @ v_target.
    rate_rad_s : (n, 3), or None
        Inertial rate of the target in target axes, the same in every frame.
    """

    t_s: Vector
    state: Matrix
    covariance: Stack
    frame: str
    metadata: dict[str, str] = field(default_factory=dict)
    dcm_frame_from_target: Stack | None = None
    rate_rad_s: Matrix | None = None

    @property
    def sigma(self) -> Matrix:
        """1-sigma of each component of `covariance`, (n, 6) or (n, 12)."""
        sigma: Matrix = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return sigma

    @property
    def q_frame_from_target(self) -> Matrix | None:
        """The attitude as quaternions (n, 4), scalar last and not negative; None where none is estimated."""
        if self.dcm_frame_from_target is None:
            return None
        out = np.empty((len(self), 4))
        quaternions_from_dcm_into(np.ascontiguousarray(self.dcm_frame_from_target), out)
        return out

    def __len__(self) -> int:
        return len(self.t_s)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame: time, state, attitude where there is one, sigmas and covariance; `attrs` holds the rest.

        Raises
        ------
        UsageError
            If pandas is not installed; says how to.
        """
        return import_module("relnav.files.data_frames").framed_dataframe(self)

    def to_xarray(self) -> Any:
        """The same as an xarray.Dataset over time, covariance as one array, units as attributes.

        Raises
        ------
        UsageError
            If xarray is not installed; says how to.
        """
        return import_module("relnav.files.data_frames").framed_xarray(self)

    def __repr__(self) -> str:
        """A few lines for the console."""
        said = f"FramedTrack of {len(self)} epochs in {self.frame}: {FRAMES[self.frame]}"
        return f"{fill(said, 80, subsequent_indent='  ')}\n  .to_dataframe()  .to_xarray()"


def in_frame(
    solution: Any, frame: str, mission: Any, orientation_deg: tuple[float, float, float] | None = None
) -> FramedTrack:
    """A solution's states, attitudes and covariances in another frame; `Solution.in_frame` describes it.

    Parameters
    ----------
    solution
        Has `t_s`, `state` (n, 6), `covariance` (n, 6 or 12, ...) and `model`; where the target's attitude is estimated
        `dcm_lvlh_from_target` (n, 3, 3) and `rate_rad_s` (n, 3).
    frame, orientation_deg
        As there.
    mission
        Has `orbit`, `dcm_dock_from_lvlh` and `port_position_m`; None if it is not known.

    Raises
    ------
    UsageError
        As `frame_words`.
    """
    t, state, covariance = (np.asarray(a) for a in (solution.t_s, solution.state, solution.covariance))
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
    attitude: Stack | None = getattr(solution, "dcm_lvlh_from_target", None)
    if attitude is None:
        return FramedTrack(t, turned, _turned_covariance(turn, covariance), frame, said)
    axes = AXES[frame]
    said["attitude"] = (
        f"q_{axes}_from_target: v_{axes} = R v_target, scalar last; its error and the rate are in target axes, the "
        "same in every frame"
    )
    attitudes = turn[:, :3, :3] @ np.asarray(attitude)
    return FramedTrack(
        t, turned, _turned_covariance(turn, covariance), frame, said, attitudes, np.asarray(solution.rate_rad_s)
    )


def _turned_covariance(turn: Stack, covariance: Stack) -> Stack:
    """Covariances (n, k, k) of which the first six rows turn: turn (n or 1, 6, 6)."""
    whole = np.zeros((len(turn), *covariance.shape[1:]))
    whole[:] = np.eye(covariance.shape[1])
    whole[:, :6, :6] = turn
    found = whole @ covariance @ np.swapaxes(whole, 1, 2)
    symmetric: Stack = 0.5 * (found + np.swapaxes(found, 1, 2))
    return symmetric


class Turning:
    """What turns a solution, part after part; it is checked when it is made.

    Attributes
    ----------
    frame : str
        One of `FRAMES`.
    stated : dict
        What the head of a table says of the frame: nothing where it is the filter's own.

    Raises
    ------
    UsageError
        As `frame_words`.
    """

    def __init__(
        self, frame: str = OWN, mission: Any = None, orientation_deg: tuple[float, float, float] | None = None
    ) -> None:
        self.frame, self._mission, self._orientation_deg = frame, mission, orientation_deg
        said = frame_words(frame, mission, orientation_deg)
        self.stated = {} if frame == OWN else said

    def __call__(self, part: Any) -> FramedTrack | None:
        """The part in the frame; None where the frame is its own."""
        return None if self.frame == OWN else in_frame(part, self.frame, self._mission, self._orientation_deg)


def frame_words(frame: str, mission: Any, orientation_deg: tuple[float, float, float] | None) -> dict[str, str]:
    """What there is to say of a frame, if all that it needs was given.

    Raises
    ------
    UsageError
        For an unknown frame, or one that needs what was not given.
    """
    if not isinstance(frame, str) or frame not in FRAMES:
        raise UsageError(f"frame is one of {', '.join(FRAMES)}; got {frame!r}")
    said = {"frame": f"{frame}: {FRAMES[frame]}"}
    if mission is None and frame in (*INERTIAL, "dock"):
        raise UsageError(f"frame {frame!r} needs the model that was flown, which is no shipped one: pass it as model=")
    if frame not in INERTIAL:
        return said
    angles = None if orientation_deg is None else numbers("orientation_deg", orientation_deg)
    if orientation_deg is None or angles is None or angles.shape != (3,) or not np.isfinite(angles).all():
        raise UsageError(
            f"frame {frame!r} needs the orientation of the target's orbit: inclination, right ascension of the "
            f"ascending node, argument of perigee, deg; got {orientation_deg!r}"
        )
    return said | {"target orbit": _orbit_words(mission.orbit, orientation_deg)}


def _inertial(t: Vector, orbit: Any, orientation_deg: tuple[float, float, float]) -> tuple[Stack, Matrix]:
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


def _orbit_words(orbit: Any, orientation_deg: tuple[float, float, float]) -> str:
    inclination, node, perigee = orientation_deg
    return (
        f"two-body, mean motion {orbit.mean_motion_rad_s:.9g} rad/s, eccentricity {orbit.eccentricity:.9g}, true "
        f"anomaly {math.degrees(orbit.true_anomaly_rad):.9g} deg at t = 0, inclination {inclination:.9g} deg, right "
        f"ascension of the ascending node {node:.9g} deg, argument of perigee {perigee:.9g} deg"
    )
