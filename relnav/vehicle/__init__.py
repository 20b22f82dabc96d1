"""One vehicle, one filter: what five sensors, a gyro and the thrusters say becomes one state with one covariance."""
