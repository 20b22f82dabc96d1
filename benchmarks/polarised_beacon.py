"""What a polarised beacon adds to a vehicle that sees stars alone: the attitude about the line of sight.

    python benchmarks/polarised_beacon.py [--runs 12]

Each run is 3 s of an approach at 5.6 m with everything drawn anew, and 11 images of the beacon, 1e6 photons each, whose
light is shared out by the true attitudes with scipy's rotations. Sigma and error are about the line of sight.
"""

import argparse
import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

import relnav
from relnav.sensors.birefringent_sun.polarised import PolarisedRoll, polarised_roll, shares
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import TARGET_ATTITUDE
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.polarised_beacon import PolarisedBeacon

MOUNTED = Rotation.from_quat([-0.5, -0.5, -0.5, 0.5])
LENS, BEACON, FIELD = np.array([0.9, 0.0, 0.1]), np.array([1.4, 0.05, 0.0]), np.array([0.0, 0.6, 0.8])
FLIGHT, END_S, EVERY_S, PHOTONS = Rendezvous(start_m=5.6, final_m=5.0), 3.0, 0.25, 1e6


def near(vehicle):
    """The vehicle 5.6 m away, with a star sensor alone."""
    over = dataclasses.replace(
        vehicle.hand_over, port_distance_m=(5.6, 0.0, 0.0), position_sigma_m=0.1, target_attitude_sigma_rad=0.01
    )
    return dataclasses.replace(vehicle, hand_over=over, sensor={"star": vehicle.sensor["star"]})


def beacon(vehicle) -> PolarisedBeacon:
    """The beacon and the sensor that sees it."""
    return PolarisedBeacon(
        vehicle, q_sensor_from_chaser=MOUNTED.as_quat(), position_m=LENS, beacon_m=BEACON, polarisation=FIELD
    )


def seen(truth, t_s: float, sensor, rng: np.random.Generator) -> PolarisedRoll:
    """What the sensor makes of the beacon's light at one time; a photon at least in each spot."""
    t = np.array([t_s])
    target = Rotation.from_matrix(truth.dcm_frame_from_target(t)[0])
    chaser = Rotation.from_matrix(truth.dcm_chaser_from_frame(t)[0])
    p = MOUNTED.apply(chaser.apply(target.apply(BEACON) - truth.motion(t)[0, :3]) - LENS)
    a = MOUNTED.apply(chaser.apply(target.apply(FIELD)))
    s = p / np.linalg.norm(p)
    across = np.array([1.0, 0.0, 0.0]) - s[0] * s
    across /= np.linalg.norm(across)
    psi = np.arctan2(a @ np.cross(s, across), a @ across)
    return polarised_roll(sensor, s, *np.maximum(rng.poisson(PHOTONS * shares(sensor, s, psi)), 1))


def fly(vehicle, seed: int, *, all_used: bool = True) -> tuple[float, float, float]:
    """1-sigma about the line of sight before and after, rad, and the error over it.

    ValueError for a refused image if all are to be used.
    """
    sensor, rng = relnav.load_model("birefringent_sun").sensor, np.random.default_rng(seed)
    run, nav = (
        simulate_rendezvous(vehicle, FLIGHT, seed=seed),
        VehicleNavigator(vehicle, sensors={"roll": beacon(vehicle)}, monitor=False),
    )
    first = float(nav.state().port.sigma[6])
    events = [(one.t_s, one.sensor, one.value) for one in run.observations if one.t_s < END_S]
    events += [(t, "roll", seen(run.truth, t, sensor, rng)) for t in np.arange(EVERY_S, END_S, EVERY_S).tolist()]
    for t_s, name, value in sorted(events, key=lambda one: one[0]):
        if nav.observe(name, t_s, value).name == "REJECTED" and all_used:
            raise ValueError(f"{name} at {t_s} s was refused")
    end = nav.state()
    off = end.dcm_lvlh_from_target.T @ run.truth.dcm_frame_from_target(np.array([end.t_s]))[0]
    sigma = float(np.sqrt(end.covariance[TARGET_ATTITUDE, TARGET_ATTITUDE][0, 0]))
    return first, float(end.port.sigma[6]), float(Rotation.from_matrix(off).as_rotvec()[0]) / sigma


def main() -> None:
    """Fly and tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=12)
    vehicle = near(relnav.load_model("rendezvous_demo"))
    flown = np.array([fly(vehicle, seed) for seed in range(parser.parse_args().runs)])
    before, after = np.degrees(flown[:, :2].max(axis=0))
    print(
        f"attitude about the line of sight, 1-sigma, the largest of {len(flown)} runs: {before:.3f} -> {after:.3f} deg"
    )
    print(f"errors over it, squared, their mean: {np.mean(flown[:, 2] ** 2):.2f}")


if __name__ == "__main__":
    main()
