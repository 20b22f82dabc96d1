"""From a raw log to a solution: currents to spots by the model's detector, and every spot at its own time."""

from pathlib import Path

import numpy as np

from relnav.accuracy.beacon_health import beacon_health, findings
from relnav.errors import LogError, ModelError
from relnav.files.raw_logs import COUNTS, RawSlots, read_raw_log
from relnav.files.text_table import TextTable
from relnav.mission import Model
from relnav.navigation.record import Solution
from relnav.navigation.slots import filter_slots
from relnav.sensors.three_beacon.psd import SlotStatus, currents_of_counts
from relnav.sensors.three_beacon.pulses import DARK
from relnav.sensors.three_beacon.slots import Slots, read_slots


def slots_of_log(raw: RawSlots, model: Model) -> Slots:
    """Spots, noise and status of a raw log's slots, by the model's detector and time code.

    Raises
    ------
    ModelError
        If the model has no [detector] and [pulses].
    LogError
        If the log is not of this model's converter or time code.
    """
    if model.detector is None or model.pulses is None:
        raise ModelError(
            f"{model.path or model.name}: a raw log is read with the model's [detector] and [pulses]; add them "
            "(three_beacon_psd shows how)"
        )
    if len(model.beacons_lvlh_m) != 3:
        raise ModelError(f"{model.path or model.name}: raw logs hold beacons a, b, c; the model lists more")
    if model.pulses.dark_slot and not (raw.beacon == DARK).any():
        raise LogError(
            f"{raw.path}: no row is of beacon 'dark', but the model's [pulses] say dark_slot = true; log the dark "
            "slots, or say false if all light is the beacons'"
        )
    full = 2**model.detector.adc_bits - 1
    if raw.counts is not None and (raw.counts > full).any():
        row, electrode = np.argwhere(raw.counts > full)[0]
        raise LogError(
            f"{raw.path}: {COUNTS[electrode]} is {raw.counts[row, electrode]:g} at {raw.t_s[row]:.15g} s, but the "
            f"model's converter of adc_bits = {model.detector.adc_bits} ends at {full}; is it this log's?"
        )
    currents = raw.currents_a if raw.counts is None else currents_of_counts(model.detector, raw.counts)
    assert currents is not None
    return read_slots(model.detector, model.pulses, model.sensor.detector_size_m, raw.t_s, raw.beacon, currents)


def filter_raw_log(
    source: Path | TextTable,
    model: Model,
    *,
    method: str = "fix",
    projection: str | None = None,
    smooth: bool = False,
) -> Solution:
    """Filter a raw log into a track, one entry a slot; how many slots were unusable and why is in the metadata.

    Raises
    ------
    LogError
        If the log cannot be read; names file, line and column.
    ModelError
        If the model does not describe the detector.
    """
    raw = read_raw_log(source)
    slots = slots_of_log(raw, model)
    solution = filter_slots(
        model,
        slots,
        acceleration_m_s2=raw.acceleration_m_s2,
        delta_v_m_s=raw.delta_v_m_s,
        q_cam_from_lvlh=raw.q_cam_from_lvlh,
        method=method,
        projection=projection,
        smooth=smooth,
    )
    solution.metadata["log"] = raw.path.name
    solution.metadata.update({f"log.{key}": value for key, value in raw.metadata.items()})
    counts = {status.name.lower(): int((slots.status == status).sum()) for status in SlotStatus}
    solution.metadata["slots"] = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    solution.metadata["spot noise"] = "not known: no slot holds a spot"
    if np.isfinite(slots.sigma_m).any():
        noise = np.nanmean(slots.sigma_m**2) ** 0.5
        solution.metadata["spot noise"] = f"{noise * 1e6:.3g} um rms, from the received power"
    wrong = findings(beacon_health(model, slots, solution, raw.q_cam_from_lvlh))
    judged = "nothing wrong found" if np.isfinite(solution.state).any() else "not judged: there is no track"
    solution.metadata["beacons"] = "; ".join(wrong) or judged
    if raw.ignored:
        solution.metadata["ignored columns"] = ", ".join(raw.ignored)
    return solution
