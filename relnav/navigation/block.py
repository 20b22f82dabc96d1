"""One float64 matrix, six columns wide, that holds a filter: constants, state, inputs, results and scratch.

One array crosses from Python into compiled code in 0.2 us; ten would cost a microsecond. Rows have names; a (6, 6)
matrix takes six rows. `Navigator` writes the constants once; `step` owns the rest.
"""

import numpy as np

from relnav.arrays import Matrix
from relnav.estimation.gating import gate_limits
from relnav.mission import Model
from relnav.sensors.three_beacon.measure import PROJECTIONS

# Constants of the model
SENSOR = 0  # f, half width x, half width y, spot sigma, a, b   (m)
SETTINGS = 1  # projection, method, attitude known, restart after, mean motion, acceleration noise density
CONTROL = 2  # magnitude sigma, direction sigma, correlation time, initial velocity sigma
GATE = 3  # chi-square limits for 1 .. 6 degrees of freedom
BEACONS = 4  # 3 rows: beacons A, B, C from the target's centre of mass, lvlh_ccsds

# What a record keeps: one piece, DOCK .. INNOVATION
DOCK = 7  # 3 rows: dcm_dock_from_lvlh | port position, lvlh_ccsds
ATTITUDE = 10  # 3 rows: dcm_cam_from_lvlh | camera from the chaser's centre of mass, camera axes
CLOCK = 13  # time of the last epoch, running, trial running, rejected streak, starts, prior position variance
TRACK = 14  # 7 rows: state x, then factors ud
RESULT = 21  # status, NIS, dof, measurement status, iterations, groups used
INNOVATION = 22  # NaN where there is none
RECORD_END = 23

# State that lasts from step to step
TRIAL = 23  # 7 rows: the start under test, state and factors
P_ROWS = 7  # rows of a track
STEP_KEY = 30  # dt and acceleration for which the three below were computed; then whether an impulse was in them
PHI = 31  # 6 rows: transition
Q_FACTORS = 37  # 6 rows: factors of the process noise
EFFECT = 43  # what the control adds to the state

# Input of one step
INPUT = 44  # acceleration, delta-v

# Scratch
H = 45  # 6 rows: measurement rows
RESIDUAL = 51  # innovations of the rows of H
VARIANCE = 52  # their variances; 0 = row not used
R_FACTOR = 53  # 3 rows: L of R = L diag L^T (methods whose noise is correlated)
VALUE = 56  # what was measured, (range, azimuth, elevation) or invariants
X_WORK = 57  # 7 rows: state and factors during the update
X_AT = 64  # point of linearisation
GAIN = 65
KEPT = 66  # 2 rows: RESULT and INNOVATION of the track while a trial is tested
WORK = 68  # 45 rows: scratch of the sensor's closed form and of the time update
ROWS = 113

METHODS = {"spots": 0, "fix": 1}
SPOTS = 0
FIX = 1


def new_block(model: Model, method: str, projection: str) -> Matrix:
    """A filter that has seen nothing yet, (ROWS, 6)."""
    block = np.zeros((ROWS, 6))
    sensor, noise, settings = model.sensor, model.process_noise, model.filter
    block[SENSOR] = (
        sensor.focal_length_m,
        0.5 * sensor.detector_size_m[0],
        0.5 * sensor.detector_size_m[1],
        model.spot_sigma_m,
        sensor.beacon_half_spacing_m,
        sensor.beacon_c_distance_m,
    )
    block[SETTINGS] = (
        PROJECTIONS[projection],
        METHODS[method],
        float(model.attitude.mode == "lvlh_hold"),
        settings.restart_after_epochs,
        model.orbit.mean_motion_rad_s,
        noise.acceleration_noise_density_m2_s3,
    )
    block[CONTROL, :4] = (
        noise.control_magnitude_sigma,
        noise.control_direction_sigma_rad,
        noise.control_correlation_time_s,
        settings.initial_velocity_sigma_m_s,
    )
    block[GATE] = gate_limits(settings.gate_probability)
    block[DOCK : DOCK + 3, :3] = model.dcm_dock_from_lvlh
    block[DOCK : DOCK + 3, 3] = model.port_position_m
    block[ATTITUDE : ATTITUDE + 3, :3] = model.dcm_cam_from_lvlh
    block[ATTITUDE : ATTITUDE + 3, 3] = model.camera_lever_cam_m
    block[BEACONS : BEACONS + 3, :3] = model.beacons_lvlh_m
    block[STEP_KEY] = np.nan
    return block
