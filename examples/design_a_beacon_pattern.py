"""Design a beacon pattern: how large a triangle, how long a lens, for a wanted accuracy at a wanted range.

python examples/design_a_beacon_pattern.py
"""

import math

import numpy as np

import relnav

WANTED_M, AT_M = 0.02, 8.0


def main() -> None:
    """Print, for each design, the 1-sigma range of one image and from where on A and B are both in view."""
    print("f, mm  a, m   range at 8 m             A and B in view from")
    place = np.array([AT_M, 0.0, 0.0])
    for focal_mm, half_m in ((50.0, 0.3), (80.0, 0.3), (60.0, 0.5), (80.0, 0.6)):
        changes = {
            "focal_length_mm": focal_mm,
            "beacon_half_spacing_m": half_m,
            "beacon_c_distance_m": math.sqrt(3.0) * half_m,  # equilateral
        }
        model = relnav.load_model("three_beacon_psd", changes)
        seen = (model.beacons_lvlh_m - place) @ model.dcm_cam_from_lvlh.T
        fix = relnav.three_beacon.measure(model.sensor.focal_length_m * seen[:, :2] / seen[:, 2:], model)
        sigma = math.sqrt(fix.covariance[0, 0])
        verdict = f"{sigma:.4f} m, {'meets' if sigma <= WANTED_M else 'misses'} {WANTED_M} m"
        nearest = model.sensor.focal_length_m * half_m / (0.5 * model.sensor.detector_size_m[0])
        verdict = verdict if fix.status.name == "OK" else fix.status.name
        print(f"{focal_mm:5.0f}  {half_m:4.1f}   {verdict:24s} {nearest:5.2f} m")


if __name__ == "__main__":
    main()
