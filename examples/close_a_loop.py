"""Close a loop: an image in, an estimate out, a thrust on the estimate; from 10 m to 6 m before the port, and hold."""

import numpy as np

import relnav

model = relnav.load_model("three_beacon_psd")
MU, DT, N, sensor = 3.986004418e14, 0.1, model.orbit.mean_motion_rad_s, model.sensor


def axes(t_s: float) -> np.ndarray:
    """Rows x, y, z of lvlh_ccsds in inertial axes, for a target on a circular orbit."""
    c, s = np.cos(N * t_s), np.sin(N * t_s)
    return np.array([[-s, c, 0.0], [0.0, 0.0, -1.0], [-c, -s, 0.0]])


def main(seconds: float = 150.0) -> None:
    """Fly it; print truth, estimate and 1-sigma every 30 s."""
    navigator, rng, command = relnav.Navigator(model, method="spots"), np.random.default_rng(1), np.zeros(3)
    place = np.array([[1.0, 0.0, 0.0]] * 2) * (MU / N**2) ** (1 / 3) + np.outer([0.0, 10.0], axes(0.0)[0])
    speed = np.cross([0.0, 0.0, N], place)  # rows target, chaser; both turn with the orbit
    for step in range(round(seconds / DT) + 1):
        t_s, truth = step * DT, axes(step * DT) @ (place[1] - place[0])
        seen = (model.beacons_lvlh_m - truth) @ model.dcm_cam_from_lvlh.T
        spots = sensor.focal_length_m * seen[:, :2] / seen[:, 2:] + sensor.spot_noise_m * rng.standard_normal((3, 2))
        record = navigator.step(t_s, spots, acceleration_m_s2=command)
        if record.has_state:
            x, goal_m, goal_m_s = record.state, max(10.0 - 0.05 * t_s, 6.0), -0.05 if t_s < 80.0 else 0.0
            command = 0.01 * ([goal_m, 0.0, 0.0] - x[:3]) + 0.2 * ([goal_m_s, 0.0, 0.0] - x[3:])
            if step % 300 == 0:
                off_mm, sigma_mm = 1e3 * np.linalg.norm(x[:3] - truth), 1e3 * record.sigma_range_m
                print(f"{t_s:5.0f} s: x {truth[0]:6.3f} m, off by {off_mm:3.1f} mm, range 1-sigma {sigma_mm:3.1f} mm")
        for _ in range(2):  # two-body orbits, half steps; the thrusters give one per cent more than commanded
            pull = -MU * place / np.linalg.norm(place, axis=1, keepdims=True) ** 3
            speed = speed + 0.5 * DT * (pull + np.outer([0.0, 1.01], command @ axes(t_s)))
            place = place + 0.5 * DT * speed


if __name__ == "__main__":
    main()
