"""The birefringent sun sensor calibrated on a turntable: errors of many calibrations over their stated 1-sigma.

    python benchmarks/birefringent_turntable.py [--tables 100]

Each table has 49 positions out to 45 deg of both angles; sensor and turn in the mount are drawn anew, spots have the
model's noise. Beside each constant: its 1-sigma as stated (mean), and the error over it (root mean square: 1).
"""

import argparse
import dataclasses

import numpy as np

import relnav
from relnav.geometry.projection_angles import direction_from_gimbal
from relnav.geometry.rotation_vector import turned
from relnav.sensors.birefringent_sun.spots import project
from relnav.sensors.birefringent_sun.turntable import FREE, calibrate_known

OFF = {"zero_spot": 0.5, "crystal_thickness_m": 1e-5, "axis_polar_rad": 0.004, "axis_azimuth_rad": 0.004}
"""1-sigma by which a built sensor is off what its model says: px, m, rad."""
TURN_RAD = np.radians(0.3)


def built(sensor, rng):
    """A sensor that is not quite as its model says."""
    zero = tuple(np.array(sensor.zero_spot_px) + OFF["zero_spot"] * rng.normal(size=2))
    others = {name: getattr(sensor, name) + off * rng.normal() for name, off in OFF.items() if name != "zero_spot"}
    return dataclasses.replace(sensor, zero_spot_px=zero, **others)


def constants(sensor):
    """In the order of FREE."""
    both = dict(zip(("zero_spot_x_px", "zero_spot_y_px"), sensor.zero_spot_px, strict=True))
    return np.array([both[name] if name in both else getattr(sensor, name) for name in FREE])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    rng, stated = np.random.default_rng(given.seed), relnav.load_model("birefringent_sun").sensor
    axis = np.radians(np.linspace(-45.0, 45.0, 7))
    s = direction_from_gimbal(*(side.ravel() for side in np.meshgrid(axis, axis)))
    ratios, sigmas, errors = [], [], []
    for _ in range(given.tables):
        true, turn = built(stated, rng), TURN_RAD * rng.normal(size=3)
        spots = project(true, s @ turned(np.eye(3), turn).T)
        found = calibrate_known(stated, spots + stated.spot_noise_px * rng.normal(size=spots.shape), s)
        sigma = np.concatenate([np.sqrt(np.diag(found.constants.covariance)), found.alignment_sigma_rad])
        error = np.concatenate([found.constants.values - constants(true), found.alignment_rad - turn])
        ratios.append(error / sigma)
        sigmas.append(sigma)
        errors.append(found.error_rad)
    rms, mean = np.sqrt(np.mean(np.square(ratios), axis=0)), np.mean(sigmas, axis=0)
    print(f"{given.tables} tables of {len(s)} positions")
    for name, sigma, ratio in zip([*FREE, "turn_x_rad", "turn_y_rad", "turn_z_rad"], mean, rms, strict=True):
        print(f"  {name:<22}1-sigma {sigma:8.2g}   error over it {ratio:5.2f}")
    print(
        f"  directions afterwards, 3 rms an axis: {3.0 * np.degrees(np.sqrt(np.mean(np.square(errors)) / 2.0)):.4f} deg"
    )


if __name__ == "__main__":
    main()
