"""The patent as written: its refraction (1)-(10), its three angles from two spots, and its product with the mounting.

The patent is "Birefringent sun sensor and its measurement of three-axis attitude" (Chinese patent).
In the patent's frame x lies in the plane of incidence, so that its phi_p is the azimuth of the axis from the sun's, not
a constant of the crystal. The text that we have shows (1), (4), (5) and (7); the others are images in it, restored from
the sentences about them. Step 6 gives no numbers: its three formulas are (11) to (13) here.

(7)-(10)  e_r = [sin(th_rp) e_k + sin(th_kp - th_rp) e_p] / sin(th_kp)
(11)      theta_j = atan(y_j / f),  psi_j = atan(x_j / f),  j = o, e      (f of the lens; d for hole and dot)
(12)      phi_m = atan2(y_e - y_o, x_e - x_o)
(13)      (theta, psi, phi)_b = T_bm (theta_m, psi_m, phi_m)

What (12) is not: a third axis. The spots depend on the sun's direction in sensor axes alone, so that phi_m is a
function of the other two angles, and a turn about the sun line changes nothing (`observability`). And (13) multiplies
three angles by a rotation matrix, which is no rotation; a direction is turned by s_b = T_bm s_m.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, numbers
from relnav.sensors.birefringent_sun.sensor import BirefringentSunSensor
from relnav.sensors.birefringent_sun.spots import metres, transverse_from_ordinary

PASSES = 60


@dataclass(frozen=True)
class PatentAngles:
    """The patent's angles of one pair of spots, rad.

    Attributes
    ----------
    theta_o_rad, psi_o_rad, theta_e_rad, psi_e_rad : float
        (11): pitch and yaw of either refracted ray.
    theta_m_rad, psi_m_rad : float
        Pitch and yaw of the incoming light, by step 5 from the ordinary ray.
    phi_m_rad : float
        (12): the patent's roll. A function of theta_m and psi_m; it says nothing about a turn about the sun line.
    """

    theta_o_rad: float
    psi_o_rad: float
    theta_e_rad: float
    psi_e_rad: float
    theta_m_rad: float
    psi_m_rad: float
    phi_m_rad: float

    @property
    def triple_rad(self) -> Vector:
        """(theta_m, psi_m, phi_m)."""
        return np.array([self.theta_m_rad, self.psi_m_rad, self.phi_m_rad])


def refracted_rays(
    theta_1_rad: float, theta_p_rad: float, phi_p_rad: float, n_o: float, n_e: float
) -> tuple[Vector, Vector]:
    """Unit ordinary and extraordinary rays (3,) in the frame of the plane of incidence, eqs (1)-(10).

    (3) is implicit in theta_k and solved by fixed-point passes with (2) and (5), as a user of the patent would.
    """
    theta_o = math.asin(math.sin(theta_1_rad) / n_o)  # (1), n_1 = 1
    e_p = np.array([
        math.sin(theta_p_rad) * math.cos(phi_p_rad), math.sin(theta_p_rad) * math.sin(phi_p_rad), math.cos(theta_p_rad)
    ])  # fmt: skip
    theta_k = theta_o
    for _ in range(PASSES):
        e_k = np.array([math.sin(theta_k), 0.0, math.cos(theta_k)])  # (4)
        theta_kp = math.acos(max(-1.0, min(1.0, float(e_k @ e_p))))  # (5)
        n_2 = n_o * n_e / math.hypot(n_o * math.sin(theta_kp), n_e * math.cos(theta_kp))  # (2)
        theta_k = math.asin(math.sin(theta_1_rad) / n_2)  # (3)
    if theta_kp > 0.5 * math.pi:  # the axis has two ends: take the nearer
        e_p, theta_kp = -e_p, math.pi - theta_kp
    ordinary = np.array([math.sin(theta_o), 0.0, math.cos(theta_o)])
    if theta_kp < 1e-9:
        return ordinary, e_k
    theta_rp = math.atan2(n_o**2 * math.sin(theta_kp), n_e**2 * math.cos(theta_kp))  # (6)
    e_r = (math.sin(theta_rp) * e_k + math.sin(theta_kp - theta_rp) * e_p) / math.sin(theta_kp)  # (7)-(10)
    return ordinary, e_r


def patent_angles(sensor: BirefringentSunSensor, spots_px: ArrayLike) -> PatentAngles:
    """Steps 4 to 6 for labelled spots (2, 2) px, rows o, e.

    Raises
    ------
    ValueError
        For another shape.
    """
    spots = numbers("spots_px", spots_px)
    if spots.shape != (2, 2):
        raise ValueError(f"spots_px has shape (2, 2), rows o, e; got {spots.shape}")
    (x_o, y_o), (x_e, y_e) = metres(sensor, spots)
    f = sensor.patent_f_m
    u = transverse_from_ordinary(sensor, np.array([x_o, y_o]))
    z = math.sqrt(1.0 - float(u @ u)) if np.all(np.isfinite(u)) else math.nan
    return PatentAngles(
        theta_o_rad=math.atan(y_o / f),
        psi_o_rad=math.atan(x_o / f),
        theta_e_rad=math.atan(y_e / f),
        psi_e_rad=math.atan(x_e / f),
        theta_m_rad=math.atan(u[1] / z),
        psi_m_rad=math.atan(u[0] / z),
        phi_m_rad=math.atan2(y_e - y_o, x_e - x_o),
    )


def patent_body_angles(angles: PatentAngles, mounting: Matrix) -> Vector:
    """(13) literally: T_bm (3, 3) times the angle triple, rad. Right only for a mounting of identity."""
    body: Vector = numbers("mounting", mounting) @ angles.triple_rad
    return body
