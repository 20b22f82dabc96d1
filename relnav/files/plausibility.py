"""What no mission has: values of a loaded model that are a slip of unit, sign or order, with the likely reason.

A limit is far beyond anything built, so that what is refused here is a mistake, not an unusual design.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from relnav.dynamics.rigid_body import RigidBody
from relnav.dynamics.two_body import MU_EARTH_M3_S2
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import Model, Orbit, VisionMission
from relnav.simulation.orbits import EARTH_RADIUS_M

if TYPE_CHECKING:  # at run time a model's class is imported when it is loaded
    from relnav.sensors.dual_field.sensor import StarSensor
    from relnav.spacecraft import Vehicle

FASTEST_RAD_S = 1.25 * math.sqrt(MU_EARTH_M3_S2 / EARTH_RADIUS_M**3)
"""A quarter more than at the ground: a body's fastest orbit is sqrt(4/3 pi G density), and no planet is denser."""
LARGEST_RAD = 0.2
"""Noise or misalignment of a sensor that anybody flies, 11 deg: above it a unit was meant otherwise."""
LARGEST_SHARE = 0.2
"""Of a focal length that its 1-sigma is: above it a percentage, or a length, was meant."""
LARGEST_PART_M, LARGEST_DETECTOR_M, FASTEST_START_M_S = 1e3, 1.0, 1e3
"""A lever arm or beacons' spacing, a detector, and what is not known of a velocity at the start of an approach."""
LATEST_S, STRONGEST_M2_S3 = 3600.0, 100.0
"""How late an image may come, and white acceleration: this much moves a velocity by 10 m/s in one second, 1-sigma."""
SHORTEST, LONGEST = 0.05, 500.0
"""Focal length in detector widths: a field of 168 deg, and of 0.1 deg."""


def implausible(mission: Any) -> list[tuple[str, str]]:
    """Key and reason of every value that cannot be; empty for a model of another kind of sensor."""
    if isinstance(mission, Model):
        return [*_orbit(mission.orbit), *_too_large(mission), *_beacon_camera(mission)]
    if isinstance(mission, VisionMission):
        return [*_orbit(mission.orbit), *_too_large(mission), *_marker_camera(mission)]
    kind = type(mission).__name__
    if kind == "StarSensor":
        return _star_camera(mission)
    if kind == "Vehicle":
        return [*_orbit(mission.orbit), *_mounted(mission)]
    return []


def _orbit(orbit: Orbit) -> list[tuple[str, str]]:
    n = orbit.mean_motion_rad_s
    if n <= FASTEST_RAD_S:
        return []
    hint = ""
    if math.radians(n) <= FASTEST_RAD_S:
        hint = "; it would be one in deg/s: write mean_motion_deg_s"
    elif 2.0 * math.pi / 86400.0 * n <= FASTEST_RAD_S:
        hint = "; it would be one in revolutions a day: multiply by 2 pi / 86400 s"
    return [
        (
            "orbit.mean_motion_rad_s",
            f"{n:.6g} rad/s is above any orbit's of the Earth, {FASTEST_RAD_S / 1.25:.4g} at the ground{hint}",
        )
    ]


def _too_large(mission: Model | VisionMission) -> list[tuple[str, str]]:
    """Lengths, angles and speeds that no approach has, whatever its unit was meant to be."""
    if isinstance(mission, Model):
        parts = {
            "docking.port_position_m": mission.docking.port_position_m,
            "camera.position_m": mission.camera.position_m,
        }
    else:
        target, chaser = mission.target, mission.chaser
        parts = {"target.port_position_m": target.port_position_m, "chaser.port_position_m": chaser.port_position_m}
    limits = {key: (max(map(abs, place)), LARGEST_PART_M, "m") for key, place in parts.items()}
    limits["filter.longest_delay_s"] = (mission.filter.longest_delay_s, LATEST_S, "s")
    density = "acceleration_noise_density_m2_s3"
    limits[f"process_noise.{density}"] = (getattr(mission.process_noise, density), STRONGEST_M2_S3, "m^2/s^3")
    if isinstance(mission, Model):
        limits |= {
            "filter.initial_velocity_sigma_m_s": (mission.filter.initial_velocity_sigma_m_s, FASTEST_START_M_S, "m/s"),
            "sensor.beacon_half_spacing_m": (mission.sensor.beacon_half_spacing_m, LARGEST_PART_M, "m"),
            "sensor.detector_size_m": (max(mission.sensor.detector_size_m), LARGEST_DETECTOR_M, "m"),
            "attitude.sigma_rad": (mission.attitude.sigma_rad, math.pi, "rad"),
            "attitude.noise_rad": (mission.attitude.noise_rad, LARGEST_RAD, "rad"),
        }
        if (built := mission.tolerances) is not None:
            spacing = mission.sensor.beacon_half_spacing_m
            limits |= {
                "tolerances.camera_mounting_sigma_rad": (built.camera_mounting_sigma_rad, LARGEST_RAD, "rad"),
                "tolerances.beacon_mounting_sigma_rad": (built.beacon_mounting_sigma_rad, LARGEST_RAD, "rad"),
                "tolerances.beacon_placement_sigma_m": (built.beacon_placement_sigma_m, spacing, "m"),
                "tolerances.focal_length_relative_sigma": (built.focal_length_relative_sigma, LARGEST_SHARE, "of it"),
            }
    return [
        (key, f"{value:.4g} {unit}; up to {most:.4g} {unit} is credible; is the unit right?")
        for key, (value, most, unit) in limits.items()
        if value > most
    ]


def _beacon_camera(mission: Model) -> list[tuple[str, str]]:
    sensor, found = mission.sensor, []
    width = min(sensor.detector_size_m)
    if sensor.spot_noise_m >= width:
        found.append(
            (
                "sensor.spot_noise_m",
                f"noise of {sensor.spot_noise_m:.4g} m on a detector of {width:.4g} m says nothing; micrometres (_um)?",
            )
        )
    ratio = sensor.focal_length_m / width
    if not SHORTEST <= ratio <= LONGEST:
        found.append(
            (
                "sensor.focal_length_m",
                f"{sensor.focal_length_m:.4g} m is {ratio:.3g} times the detector's width of {width:.4g} m, and "
                f"{SHORTEST:g} to {LONGEST:g} times is a lens; are both units right?",
            )
        )
    beacons = [tuple(place) for place in sensor.beacons_dock_m.tolist()]
    if len(set(beacons)) < len(beacons):
        twice = next(place for place in beacons if beacons.count(place) > 1)
        found.append(("sensor.extra_beacons_m", f"two beacons stand at {list(twice)} m; give each its own place"))
    if mission.attitude.mode == "lvlh_hold":
        towards = -mission.dcm_dock_from_lvlh[0]
        found += _looks_away("attitude.q_cam_from_lvlh", mission.attitude.q_cam_from_lvlh, towards)
    return found


def _star_camera(sensor: "StarSensor") -> list[tuple[str, str]]:
    camera = sensor.camera
    return _pixels("detector", min(camera.detector_size_px), camera.spot_noise_px, camera.focal_length_px)


def _mounted(vehicle: "Vehicle") -> list[tuple[str, str]]:
    """Star sensors of a vehicle: their noise and alignment are of small angles."""
    found = []
    for name, mounted in vehicle.sensor.items():
        angles = {"noise_rad": max(mounted.noise_rad or (0.0,)), "mount_sigma_rad": mounted.mount_sigma_rad}
        for key, value in angles.items():
            if value > LARGEST_RAD:
                found.append(
                    (f"sensor.{name}.{key}", f"{value:.4g} rad is {math.degrees(value):.3g} deg; arcsec, mrad or deg?")
                )
    return found


def _pixels(what: str, width: float, noise: float, focal: float) -> list[tuple[str, str]]:
    """Of a camera in pixels."""
    found = []
    if noise >= width:
        found.append(("camera.spot_noise_px", f"noise of {noise:g} px on {width:g} px says nothing"))
    ratio = focal / width
    if not SHORTEST <= ratio <= LONGEST:
        found.append(
            (
                "camera.focal_length_px",
                f"{focal:.4g} px is {ratio:.3g} times the {what}'s width of {width:g} px, and {SHORTEST:g} to "
                f"{LONGEST:g} times is a lens; millimetres? divide by the pixel's size",
            )
        )
    return found


def _marker_camera(mission: VisionMission) -> list[tuple[str, str]]:
    camera = mission.camera
    found = _pixels("image", min(camera.image_size_px), camera.spot_noise_px, min(camera.focal_length_px))
    for axis, (centre, size) in enumerate(zip(camera.principal_point_px, camera.image_size_px, strict=True)):
        if not 0.0 <= centre <= size:
            found.append(
                (
                    "camera.principal_point_px",
                    f"{centre:g} px along {'xy'[axis]} lies outside the image of {size} px; of another image?",
                )
            )
    points = mission.markers.positions_m
    if len(set(points)) < len(points):
        twice = next(point for point in points if points.count(point) > 1)
        found.append(("markers.positions_m", f"two markers stand at {list(twice)} m; give each its own place"))
    try:
        RigidBody(np.array(mission.target.inertia_kg_m2), 0.0)
    except ValueError as wrong:
        found.append(("target.inertia_kg_m2", str(wrong)))
    return found + _looks_away("view.q_cam_from_target", mission.view.q_cam_from_target, np.array([-1.0, 0.0, 0.0]))


def _looks_away(key: str, quaternion: tuple[float, float, float, float], towards: Any) -> list[tuple[str, str]]:
    """A camera (boresight +z) 90 deg or more off the way to the target, and which other reading would look there."""
    x, y, z, w = quaternion
    off = _off_deg(quaternion, towards)
    if off < 89.9:
        return []
    readings = {
        "scalar first: write x, y, z, w": (y, z, w, x),
        "the inverse rotation: turn the signs of x, y, z": (-x, -y, -z, w),
    }
    fitting = [name for name, other in readings.items() if _off_deg(other, towards) < 45.0]
    hint = f"it would look there as {fitting[0]}" if fitting else "v_cam = R v, scalar last, boresight +z, is expected"
    return [(key, f"the camera looks away from the target, {off:.0f} deg off; {hint}")]


def _off_deg(quaternion: tuple[float, float, float, float], towards: Any) -> float:
    return math.degrees(math.acos(float(np.clip(dcm_from_quaternion(np.array(quaternion))[2] @ towards, -1.0, 1.0))))
