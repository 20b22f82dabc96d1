"""Your own measurement in the filter: a range finder beside the sensors of the shipped vehicle, in one class.

python examples/your_own_measurement.py
"""

import numpy as np

import relnav
from relnav.accuracy.rendezvous import true_port
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import LastingError
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.port import port_state
from relnav.vehicle.rows import Rows

vehicle = relnav.load_model("rendezvous_demo")
NOISE_M, BIAS_M = 0.001, 0.012


class RangeFinder:
    """Distance from port to port, with noise of a millimetre and a constant error of a centimetre (1-sigma)."""

    lasting, most_rows = (LastingError("bias", 1, 0.01),), 1

    def placed(self, name, layout):
        """Note where the filter keeps this sensor's bias in its state."""
        self.bias, self.size = layout.by_name[f"{name}.bias"], layout.size

    def taken(self, value, covariance):
        """Turn what `observe` was given into numbers and the covariance of their noise."""
        return np.array([float(value)]), np.array([[NOISE_M**2 if covariance is None else float(covariance)]])

    def rows(self, state, value, noise):
        """Residual z - h(x), its derivatives by all errors of the state, and its noise."""
        port, by_errors = port_state(vehicle, OrbitFrame(vehicle.orbit), state, np.zeros(3))
        distance, H = np.linalg.norm(port.position_m), np.zeros((1, self.size))
        H[0] = port.position_m / distance @ by_errors[:3]
        H[0, self.bias] = 1.0
        return Rows(value - distance - state.values[self.bias], H, noise, 1)


def main(end_s: float = 4.5) -> None:
    """Fly the first seconds of the shipped rendezvous twice: without the range finder, and with it."""
    run = simulate_rendezvous(vehicle, Rendezvous(final_m=29.5), seed=1)
    seen = [(one.t_s, one.sensor, one.value) for one in run.observations if one.t_s < end_s]
    rng = np.random.default_rng(2)
    ranges = [
        (t, "lidar", np.linalg.norm(true_port(run, t)[0][:3]) + BIAS_M + NOISE_M * rng.standard_normal())
        for t in np.arange(0.25, end_s, 0.5)
    ]
    for name, events, sensors in (("without", seen, {}), ("with", [*seen, *ranges], {"lidar": RangeFinder()})):
        navigator = relnav.VehicleNavigator(vehicle, sensors=sensors)
        for t_s, sensor, value in sorted(events, key=lambda event: event[0]):
            navigator.observe(sensor, t_s, value)
        now = navigator.state()
        off_mm = 1e3 * (now.port.position_m - true_port(run, now.t_s)[0][:3])
        print(f"{name:8s}x off by {off_mm[0]:5.1f} mm, 1-sigma {1e3 * now.port.sigma[0]:4.1f} mm")
    lidar = now.sensors["lidar"]
    print(f"lidar last used at {lidar.last_used_s:.2f} s, refused {lidar.refused}; alarms: {len(now.alarms)}")


if __name__ == "__main__":
    main()
