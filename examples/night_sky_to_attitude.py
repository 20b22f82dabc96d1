"""From a picture of the night sky to an attitude: find the stars, tell which they are, and say how sure that is.

python examples/night_sky_to_attitude.py [PICTURE]
"""

import sys
from pathlib import Path

import numpy as np

import relnav
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator
from relnav.simulation.star_picture import Exposure, picture_of


def simulated_picture(camera: object) -> tuple[np.ndarray, np.ndarray]:
    """A picture of a random place in the sky, and the true attitude, v_cam = dcm @ v_icrs."""
    rng = np.random.default_rng(4)
    sky = StarFieldSimulator(camera, SkyConditions(faintest_mag=6.5, false_spots=0)).frame(rng)
    exposure = Exposure(zero_point=16.92)
    return picture_of(sky.spots_px, exposure.flux(sky.magnitude), (1024, 768), exposure, rng), sky.dcm_cam_from_icrs


def main(path: str | None = None) -> None:
    """Solve a picture, yours or a simulated one, with the shipped ground camera."""
    camera = relnav.load_model("ground_camera")
    truth = None
    if path is None:
        picture, truth = simulated_picture(camera)
    else:
        from relnav.files.images import read_picture

        picture = read_picture(Path(path)).counts
    stars = relnav.find_stars(picture, electrons_per_count=2.0)
    solution = relnav.dual_field.measure(stars.spots_px, camera, flux=stars.flux)
    print(f"{len(stars.flux)} stars found, {solution.matches} identified: {solution.status}")
    print("1-sigma about x, y, z:", np.round(np.degrees(solution.sigma_rad) * 3600.0, 1), "arcsec")
    if truth is not None:
        turn = solution.dcm_cam_from_icrs @ truth.T
        off = 0.5 * np.array([turn[1, 2] - turn[2, 1], turn[2, 0] - turn[0, 2], turn[0, 1] - turn[1, 0]])
        print("true error within 3 sigma:", bool(np.all(np.abs(off) < 3.0 * solution.sigma_rad)))


if __name__ == "__main__":
    main(*sys.argv[1:])
