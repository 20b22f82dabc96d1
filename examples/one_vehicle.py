"""One vehicle, one filter: beacons, markers, stars, two sun sensors, a gyro and thrusters, in the order they arrive.

python examples/one_vehicle.py
"""

from collections import Counter

import numpy as np

import relnav
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous


def main(final_m: float = 29.5) -> None:
    """Fly the first metres of the shipped rendezvous and print what is known at the docking port."""
    vehicle = relnav.load_model("rendezvous_demo")
    run = simulate_rendezvous(vehicle, Rendezvous(final_m=final_m), seed=1)
    navigator = relnav.VehicleNavigator(vehicle)
    verdicts = Counter()
    for seen in run.observations:  # yours: (name in the vehicle file, time it was made, what it says)
        verdicts[navigator.observe(seen.sensor, seen.t_s, seen.value).name] += 1
    now = navigator.state()
    print(dict(sorted(verdicts.items())))
    for axis, value, sigma in zip("xyz", now.port.position_m, now.port.sigma, strict=False):
        print(f"port {axis} {value:6.2f} m +- {1e3 * sigma:.0f} mm")
    print(f"attitude 1-sigma {np.degrees(now.port.sigma[6:9]).max():.2f} deg; sensors: {', '.join(now.sensors)}")


if __name__ == "__main__":
    main()
