"""A sensor of your own: copy a shipped model, change what you build, and see what it buys before you build it.

python examples/your_own_sensor.py
"""

import re
import tempfile
from pathlib import Path

import numpy as np

import relnav


def main() -> None:
    """Compare the shipped sensor with one of a longer lens and larger triangle, at 8 m."""
    shipped = relnav.load_model("three_beacon_psd")
    with tempfile.TemporaryDirectory() as folder:
        mine = Path(folder) / "my_sensor.toml"
        text = Path(shipped.path).read_text()  # or: relnav models three_beacon_psd --copy my_sensor.toml
        text = re.sub(r"focal_length_mm = .*", "focal_length_mm = 75.0", text)
        text = re.sub(r"beacon_half_spacing_m = .*", "beacon_half_spacing_cm = 36.0", text)
        text = re.sub(r"beacon_c_distance_m = .*", "beacon_c_distance_cm = 62.4", text)
        mine.write_text(text)
        model = relnav.load_model(mine)
    for name, mission in (("shipped", shipped), ("mine", model)):
        seen = (mission.beacons_lvlh_m - [8.0, 0.0, 0.0]) @ mission.dcm_cam_from_lvlh.T
        fix = relnav.three_beacon.measure(mission.sensor.focal_length_m * seen[:, :2] / seen[:, 2:], mission)
        sigma = np.sqrt(np.diag(fix.covariance))
        print(f"{name:8s} one image at 8 m: range +- {sigma[0]:.3f} m, azimuth +- {np.degrees(sigma[1]):.2f} deg")


if __name__ == "__main__":
    main()
