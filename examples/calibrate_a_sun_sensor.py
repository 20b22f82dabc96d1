"""Calibrate a sun sensor from turntable points, and use the calibration.

python examples/calibrate_a_sun_sensor.py
"""

from pathlib import Path

import numpy as np

import relnav
from relnav.files.sun_calibration import calibrate_sun

POINTS = Path(__file__).parent / "aps_sun_turntable" / "turntable.csv"


def main() -> None:
    """Print the error before, after (each point by the others), and the direction of one spot."""
    model = relnav.load_model("aps_sun")
    report = calibrate_sun(POINTS, model)
    calibration = report.result.calibration
    before, after = np.degrees(report.before_rad), np.degrees(report.result.error_rad)
    print(
        f"{len(after)} points; largest error {np.abs(before).max():.1f} deg before, {np.abs(after).max():.3f} deg after"
    )
    sun = relnav.aps_sun.measure([612.4, 433.1], model, calibration=calibration)
    print(f"spot (612.4, 433.1) px: {sun.status.name}, 1-sigma {np.degrees(sun.sigma_rad):.4f} deg")


if __name__ == "__main__":
    main()
