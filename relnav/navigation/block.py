"""One float64 matrix, six columns wide, that holds a filter: constants, state, inputs, results and scratch.

One array crosses from Python into compiled code in 0.2 us; ten would cost a microsecond. Rows have names; a (6, 6)
matrix takes six rows. The rows that depend on the number of beacons come last; LAYOUT says where. `Navigator` writes
the constants once; `step` owns the rest.
"""

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.estimation.gating import gate_limits
from relnav.mission import Model
from relnav.sensors.three_beacon.measure import PROJECTIONS

# Constants of the model
SENSOR = 0  # f, half width x, half width y, spot sigma, a, b   (m)
SETTINGS = 1  # projection, method, attitude known, restart after, mean motion, acceleration noise density
CONTROL = 2  # magnitude sigma, direction sigma, correlation time, initial velocity sigma
LAYOUT = 3  # number of beacons; first rows: gate limits, beacons, results set aside, sensitivities of track, of trial
TOLERANCES = 4  # 1-sigma: focal length, relative; camera mounting, beacon mounting (rad); beacon placement (m)
FIELD = 5  # where what lasts in the spots was calibrated: centre, half widths (m)

# Derived from the attitude (`sight.set_attitude`)
CAM_FROM_DOCK = 6  # 3 rows: dcm_cam_from_dock
OFFSET = 9  # camera minus chaser's centre of mass, minus the port: camera from O = state + OFFSET, lvlh_ccsds

# State that lasts from step to step
TRIAL = 10  # 7 rows: the start under test, state and factors
P_ROWS = 7  # rows of a track
STEP_KEY = 17  # dt and acceleration for which the three below were computed; then whether an impulse was in them
PHI = 18  # 6 rows: transition
Q_FACTORS = 24  # 6 rows: factors of the process noise
EFFECT = 30  # what the control adds to the state

# Input of one step
INPUT = 31  # acceleration, delta-v

# Scratch of the update
X_WORK = 32  # 7 rows: state and factors during the update
X_AT = 39  # point of linearisation
PLACE = 40  # camera from O in the docking frame at the prediction (3), its range^2, the prior's position variance
RAYS = 41  # 3 rows: rays of the measured spots, camera axes
FIX_AT = 44  # position of the fix (3), docking frame
VALUE = 45  # invariants measured (3), then those at the prediction (3)
INVERSE = 46  # 3 rows: (dg/dp)^-1
JACOBIAN = 49  # 3 rows: d value / d spots
H = 52  # 3 rows: measurement rows of a fix or of invariants, made independent
RESIDUAL = 55  # their innovations, independent (3) and as they are (3)
VARIANCE = 56  # variances of the independent rows; 0 = row not used
R_FACTOR = 57  # 3 rows: L of R = L diag L^T
WORK = 60  # 24 rows: scratch of the closed form, of a start, of a step

# What a record keeps: one piece, DOCK .. the innovations and the track's sensitivities
DOCK = 84  # 3 rows: dcm_dock_from_lvlh | port position, lvlh_ccsds
ATTITUDE = 87  # 3 rows: dcm_cam_from_lvlh | camera from the chaser's centre of mass, camera axes
CLOCK = 90  # time of the last epoch, running, trial running, rejected streak, starts, number of beacons
TRACK = 91  # 7 rows: state x, then factors ld
RESULT = 98  # status, NIS, dof, measurement status, iterations, groups used
INNOVATION = 99  # two numbers a beacon, row after row; NaN where there is none

# Where errors are considered, from LAYOUT's fifth and sixth number on: what one sigma of each does to the state of the
# track, and of the trial; before those of the trial as many rows of scratch (`considered.py`)

# A beacon's four rows, from LAYOUT's second number on
BEACON_ROWS = 4
POSITION = (
    0  # position from the target's centre of mass, lvlh_ccsds (3); sigma of its spot's noise x, y, and of what lasts
)
OBSERVED = 1  # residual x, y; variance x, y (0 = coordinate not used)
GRADIENT = 2  # 2 rows: measurement rows

NODES = 4
"""Along each side of the detector's field of lasting errors."""
FIELD_ERRORS = 2 * NODES * NODES
TOLERANCES_SHARED = 7
"""Tolerances that all beacons share: the focal length, three turns of the camera, three of the beacons."""

METHODS = {"spots": 0, "fix": 1}
SPOTS = 0
FIX = 1


def rows_for(numbers: int) -> int:
    """Rows that so many numbers fill."""
    return -(-numbers // 6)


def results_end(beacons: int) -> int:
    """Row after the innovations: the first of the track's sensitivities, if there are any."""
    return INNOVATION + rows_for(2 * beacons)


def new_block(model: Model, method: str, projection: str) -> Matrix:
    """A filter that has seen nothing yet, (rows, 6)."""
    sensor, noise, settings = model.sensor, model.process_noise, model.filter
    beacons = model.beacons_lvlh_m
    count = len(beacons)
    tolerances = model.tolerances if model.tolerances is not None and model.tolerances.considered else None
    lasting = model.lasting_spot_sigma_m
    calibration = model.calibration
    considered = 0 if tolerances is None and calibration is None else FIELD_ERRORS
    considered += 0 if tolerances is None else TOLERANCES_SHARED + 3 * count
    results = results_end(count)
    gate = results + considered
    first_beacon = gate + rows_for(2 * count)
    kept = first_beacon + BEACON_ROWS * count
    trial = kept + results - RESULT + considered
    block = np.zeros((trial + considered, 6))
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
    if tolerances is not None:
        block[TOLERANCES, :4] = (
            tolerances.focal_length_relative_sigma,
            tolerances.camera_mounting_sigma_rad,
            tolerances.beacon_mounting_sigma_rad,
            tolerances.beacon_placement_sigma_m,
        )
    block[FIELD, 2:4] = block[SENSOR, 1:3]
    if calibration is not None:
        block[FIELD, :4] = *calibration.center_m, *calibration.half_width_m
    block[LAYOUT] = count, gate, first_beacon, kept, results, trial
    block[CLOCK, 0], block[CLOCK, 5] = -np.inf, count
    block[gate:first_beacon].ravel()[: 2 * count] = gate_limits(settings.gate_probability, 2 * count)
    block[DOCK : DOCK + 3, :3] = model.dcm_dock_from_lvlh
    block[DOCK : DOCK + 3, 3] = model.port_position_m
    block[ATTITUDE : ATTITUDE + 3, 3] = model.camera_lever_cam_m
    block[first_beacon:kept:BEACON_ROWS, :3] = beacons
    block[first_beacon:kept:BEACON_ROWS, 3:5] = sensor.spot_noise_m
    block[first_beacon:kept:BEACON_ROWS, 5] = lasting
    block[STEP_KEY] = np.nan
    return block


@kernel
def beacon_count(block: Matrix) -> int:
    """Number of beacons."""
    return int(block[LAYOUT, 0])


@kernel
def beacon_row(block: Matrix, beacon: int) -> int:
    """First of the four rows of a beacon."""
    return int(block[LAYOUT, 2]) + BEACON_ROWS * beacon


@kernel
def gate_limit(block: Matrix, dof: int) -> float:
    """Chi-square limit for so many degrees of freedom."""
    return float(block[int(block[LAYOUT, 1]) + (dof - 1) // 6, (dof - 1) % 6])


@kernel
def set_spot_sigma(block: Matrix, sigma: Matrix) -> None:
    """Set the 1-sigma (beacons, 2) m of the spots' noise from this epoch on; where it is NaN the last one stays."""
    for beacon in range(int(block[LAYOUT, 0])):
        row = int(block[LAYOUT, 2]) + BEACON_ROWS * beacon
        for k in range(2):
            if sigma[beacon, k] > 0.0:
                block[row + POSITION, 3 + k] = sigma[beacon, k]


@kernel
def set_lasting_sigma(block: Matrix, sigma: Vector) -> None:
    """Set the 1-sigma (beacons,) m of what lasts in the spots of this epoch."""
    for beacon in range(int(block[LAYOUT, 0])):
        block[int(block[LAYOUT, 2]) + BEACON_ROWS * beacon + POSITION, 5] = sigma[beacon]
