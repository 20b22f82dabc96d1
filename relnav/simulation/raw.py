"""A whole simulated raw log: four converter counts a slot, one beacon at a time."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.mission import Model
from relnav.sensors.three_beacon.psd import counts_of_currents, currents_of_spots, noisy_currents
from relnav.sensors.three_beacon.pulses import DARK, Pulses
from relnav.simulation.beacon_faults import BeaconFault, in_slot, mirrored, shining
from relnav.simulation.detector import background_current_a, misplaced, photocurrents, project_beacons
from relnav.simulation.distortion import Distortion
from relnav.simulation.trajectory import Approach, fly


@dataclass(frozen=True)
class RawLog:
    """A raw log and its truth, one entry a slot.

    Attributes
    ----------
    t_s, beacon : (n,), (n,)
        Middle of the slot, and whose it is: 0, 1, 2, or 3 for the dark slot.
    counts : (n, 4)
        Converter output of x1, x2, y1, y2 (a mean, if a slot has several samples).
    acceleration_m_s2 : (n, 3)
        As commanded, held over the interval that ends at the row.
    truth : (n, 6)
        True relative states at the slots' middles.
    """

    t_s: Vector
    beacon: Codes
    counts: Matrix
    acceleration_m_s2: Matrix
    truth: Matrix


def slot_counts(
    model: Model,
    state: Matrix,
    beacon: Codes,
    rng: np.random.Generator,
    *,
    dcm_cam_from_lvlh: Stack | None = None,
    distortion: Distortion | None = None,
    late_s: float = 0.0,
    faults: tuple[BeaconFault, ...] = (),
    t_s: Vector | None = None,
) -> Matrix:
    """Converter counts (n, 4) of slots of these beacons (n,) at true states (n, 6).

    faults: of beacons, at the times t_s (n,) of the slots. late_s: how late the receiver samples by the beacons' clock
    (`Pulses.lit`). Attitude (n, 3, 3), the model's if left out. distortion: of the detector; that of the model's
    calibration if left out.
    """
    pulses = _pulses(model)
    detector, size = model.detector, model.sensor.detector_size_m
    spots = project_beacons(model, state, dcm_cam_from_lvlh)
    current = photocurrents(model, state, dcm_cam_from_lvlh)
    if faults:
        if t_s is None:
            raise ValueError("faults happen at times: t_s (n,) is needed with them")
        spots = mirrored(faults, t_s, spots, 0.5 * np.array(size), rng)
        current = current * shining(faults, t_s)
        beacon = in_slot(faults, t_s, beacon)
    spots = misplaced(model, spots, rng) if distortion is None else distortion.apply(spots)
    on = np.all(np.abs(spots) <= 0.5 * np.array(size), axis=-1)
    share = pulses.lit(late_s)[beacon][:, :3]
    assert detector is not None  # photocurrents has asked
    each = currents_of_spots(
        detector, size, np.where(np.expand_dims(on, -1), spots, 0.0), np.where(on, current * share, 0.0)
    )
    mean = each.sum(axis=1) + background_current_a(model)
    out, full = np.empty((len(mean), 4)), 2.0**detector.adc_bits - 1.0
    for rows, samples in ((beacon != DARK, pulses.samples), (beacon == DARK, pulses.dark_samples)):
        counts = counts_of_currents(detector, noisy_currents(detector, np.repeat(mean[rows, None], samples, 1), rng))
        out[rows] = np.where((counts >= full).any(axis=1), full, counts.mean(axis=1))
    return out


def simulate_raw(
    model: Model,
    approach: Approach | None = None,
    seed: int = 0,
    *,
    distortion: Distortion | None = None,
    late_s: float = 0.0,
    faults: tuple[BeaconFault, ...] = (),
) -> RawLog:
    """Simulate an approach as a raw log: a row a slot, at the model's time code (the approach's own rate is not used).

    Raises
    ------
    ValueError
        If the model has no [detector], [light] and [pulses].
    """
    pulses = _pulses(model)
    flight, sensor = (np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(2))
    slots = dataclasses.replace(approach or Approach(), rate_hz=1.0 / pulses.slot_s)
    t, truth, command = fly(model, slots, flight)
    beacon = np.arange(len(t)) % pulses.slots
    counts = slot_counts(model, truth, beacon, sensor, distortion=distortion, late_s=late_s, faults=faults, t_s=t)
    return RawLog(t, beacon, counts, command, truth)


def _pulses(model: Model) -> Pulses:
    if model.pulses is None or model.detector is None or model.light is None:
        raise ValueError(f"model {model.name} has no [detector], [light] and [pulses]: raw logs need all three")
    if len(model.beacons_lvlh_m) != 3:
        raise ValueError(f"raw logs hold beacons a, b, c; model {model.name} lists {len(model.beacons_lvlh_m)}")
    return model.pulses
