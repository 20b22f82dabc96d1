"""Close a loop: estimate from images, thrust on the estimate, from 10 m to 6 m in front of the port, and hold.

python examples/close_a_loop.py
"""

import numpy as np

import relnav

model = relnav.load_model("three_beacon_psd")
navigator = relnav.Navigator(model, method="spots")
rng = np.random.default_rng(1)
MU, DT, THRUST_ERROR = 3.986004418e14, 0.1, 1.01  # the thrusters give one per cent more than they are told
n = model.orbit.mean_motion_rad_s
radius_m = (MU / n**2) ** (1 / 3)


def orbital_axes(t_s: float) -> np.ndarray:
    """Rows x, y, z of lvlh_ccsds in inertial axes, for a target on a circular orbit."""
    c, s = np.cos(n * t_s), np.sin(n * t_s)
    return np.array([[-s, c, 0.0], [0.0, 0.0, -1.0], [-c, -s, 0.0]])


def spots_of(position_m: np.ndarray) -> np.ndarray:
    """What the detector shows: central projection of the three beacons, with noise."""
    seen = (model.beacons_lvlh_m - position_m) @ model.dcm_cam_from_lvlh.T
    spots = model.sensor.focal_length_m * seen[:, :2] / seen[:, 2:]
    return spots + model.sensor.spot_noise_m * rng.standard_normal((3, 2))


def main(seconds: float = 150.0) -> None:
    """Fly it; print truth, estimate and 1-sigma every 30 s."""
    target, chaser = np.array([radius_m, 0.0, 0.0]), np.array([radius_m, 0.0, 0.0]) + orbital_axes(0.0)[0] * 10.0
    v_target = v_chaser = np.array([0.0, n * radius_m, 0.0])
    v_chaser = v_chaser + np.cross([0.0, 0.0, n], chaser - target)  # at rest in the turning frame
    command = np.zeros(3)
    for step in range(round(seconds / DT) + 1):
        t_s = step * DT
        truth = orbital_axes(t_s) @ (chaser - target)
        record = navigator.step(t_s, spots_of(truth), acceleration_m_s2=command)
        if record.has_state:
            wanted = np.array([max(10.0 - 0.05 * t_s, 6.0), 0.0, 0.0])
            closing = np.array([-0.05 if wanted[0] > 6.0 else 0.0, 0.0, 0.0])
            command = 0.01 * (wanted - record.state[:3]) + 0.2 * (closing - record.state[3:])
        if step % 300 == 0 and record.has_state:
            off = 1e3 * np.linalg.norm(record.state[:3] - truth)
            print(f"{t_s:5.0f} s: range {np.linalg.norm(truth):6.3f} m, estimate off by {off:4.1f} mm, "
                  f"1-sigma of range {1e3 * record.sigma_range_m:4.1f} mm")  # fmt: skip
        for _ in range(2):  # two half steps of both orbits (leapfrog), thrust held in lvlh_ccsds
            thrust = THRUST_ERROR * command @ orbital_axes(t_s)
            v_target = v_target - 0.5 * DT * MU * target / np.linalg.norm(target) ** 3
            v_chaser = v_chaser + 0.5 * DT * (thrust - MU * chaser / np.linalg.norm(chaser) ** 3)
            target, chaser = target + 0.5 * DT * v_target, chaser + 0.5 * DT * v_chaser


if __name__ == "__main__":
    main()
