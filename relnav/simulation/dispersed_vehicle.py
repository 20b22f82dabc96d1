"""One run of a vehicle's scenario: what is uncertain is drawn, then it is flown and seen by every sensor."""

import dataclasses
import math
from collections.abc import Mapping

from relnav.simulation.rendezvous import Rendezvous, is_free
from relnav.simulation.rendezvous_motion import CONTROL_DAMPING, CONTROL_RAD_S
from relnav.simulation.streams import Draws, Stream
from relnav.simulation.vehicle_dispersions import FAULTS, VehicleScenario
from relnav.simulation.vehicle_faults import VehicleFault, with_fault
from relnav.simulation.vehicle_numbers import OfRun
from relnav.simulation.vehicle_sensors import VehicleRun, simulate_rendezvous
from relnav.spacecraft import GYRO, POINTS, Vehicle

PEAK_RATE = math.exp(-math.acos(CONTROL_DAMPING) * CONTROL_DAMPING / math.sqrt(1.0 - CONTROL_DAMPING**2))
"""Largest rate of an attitude that is turned back, over that attitude and the control's natural frequency."""
MOST_BEYOND = 9.0
"""By how much a target's control may exceed the white angular acceleration that is stated: three times in size."""


def default_scenario(vehicle: Vehicle) -> VehicleScenario:
    """The approach from the vehicle's own hand-over."""
    return VehicleScenario(Rendezvous(start_m=vehicle.hand_over.port_distance_m[0]))


def check_vehicle_scenario(vehicle: Vehicle, scenario: VehicleScenario) -> None:
    """Raise a ValueError where a scenario asks for what a vehicle has not got."""
    if not isinstance(scenario, VehicleScenario):
        raise ValueError(
            "a vehicle's scenario is expected, relnav.load_scenario(..., model=vehicle); "
            f"got a {type(scenario).__name__}"
        )
    known = ("none", GYRO, *vehicle.sensor)
    if scenario.fault.sensor not in known:
        raise ValueError(f"fault.sensor is one of {', '.join(known)}; got '{scenario.fault.sensor}'")
    if (
        scenario.fault.kind == "glint"
        and scenario.fault.sensor != "none"
        and (scenario.fault.sensor == GYRO or vehicle.kind(scenario.fault.sensor) != POINTS)
    ):
        raise ValueError(f"fault.kind glint is for a sensor that sees lights; {scenario.fault.sensor} sees none")


def control_note(vehicle: Vehicle, scenario: VehicleScenario) -> str:
    """A sentence on a target whose control turns it by more than the filter expects; empty for others.

    The control takes out the rate that a target has at first, and what it gives it to turn it back: changes within
    1 / CONTROL_RAD_S. White angular acceleration of density q changes a rate by the root of q times that.
    """
    flight, start = scenario.approach, as_flown(vehicle, scenario).hand_over
    stated = vehicle.target.rate_noise_density_rad2_s3
    if flight.as_believed or is_free(vehicle, flight):
        return ""
    turned_back = PEAK_RATE * CONTROL_RAD_S * start.target_attitude_sigma_rad
    change = math.hypot(start.target_rate_sigma_rad_s, turned_back)
    density = change * change * CONTROL_RAD_S
    if density <= MOST_BEYOND * stated:
        return ""
    expected = math.degrees(math.sqrt(stated / CONTROL_RAD_S))
    return (
        f"the target's control changes its rate by {math.degrees(change):.2g} deg/s (1-sigma) within "
        f"{1.0 / CONTROL_RAD_S:g} s, and by target.rate_noise_density_rad2_s3 the filter expects {expected:.2g} deg/s: "
        'its covariance is too small. For a target that nobody controls set approach.target to "free"; for one that '
        f"is controlled, that density to {density:.1g}"
    )


def as_flown(vehicle: Vehicle, scenario: VehicleScenario) -> Vehicle:
    """The vehicle with the errors that the scenario draws, and its start."""
    start, spread, thrust, built = vehicle.hand_over, scenario.spread, scenario.thrust, scenario.as_built
    aside = start.port_distance_m[1:]

    def of(stated: float, wanted: float | None) -> float:
        return stated if wanted is None else wanted

    return dataclasses.replace(
        vehicle,
        hand_over=dataclasses.replace(
            start,
            port_distance_m=(scenario.approach.start_m, *aside),
            position_sigma_m=of(start.position_sigma_m, spread.start_sigma_m),
            velocity_sigma_m_s=of(start.velocity_sigma_m_s, spread.velocity_sigma_m_s),
            chaser_attitude_sigma_rad=of(start.chaser_attitude_sigma_rad, spread.chaser_attitude_sigma_rad),
            target_attitude_sigma_rad=of(start.target_attitude_sigma_rad, spread.target_attitude_sigma_rad),
            target_rate_sigma_rad_s=of(start.target_rate_sigma_rad_s, spread.target_rate_sigma_rad_s),
        ),
        thrust=dataclasses.replace(
            vehicle.thrust,
            scale_sigma=of(vehicle.thrust.scale_sigma, thrust.scale_sigma),
            direction_sigma_rad=of(vehicle.thrust.direction_sigma_rad, thrust.direction_sigma_rad),
        ),
        gyro=dataclasses.replace(
            vehicle.gyro,
            scale_sigma=of(vehicle.gyro.scale_sigma, scenario.gyro.scale_sigma),
            misalignment_sigma_rad=of(vehicle.gyro.misalignment_sigma_rad, scenario.gyro.misalignment_sigma_rad),
        ),
        sensor={
            name: dataclasses.replace(
                mounted,
                mount_sigma_rad=built.mount_scale * mounted.mount_sigma_rad,
                lever_sigma_m=built.lever_scale * mounted.lever_sigma_m,
                focal_sigma=built.focal_scale * mounted.focal_sigma,
                points_sigma_m=built.points_scale * mounted.points_sigma_m,
            )
            for name, mounted in vehicle.sensor.items()
        },
    )


def as_believed(vehicle: Vehicle, scenario: VehicleScenario) -> Vehicle:
    """The vehicle as its filter takes it: that of the file, but for where the approach begins."""
    start = vehicle.hand_over
    distance = (scenario.approach.start_m, *start.port_distance_m[1:])
    return dataclasses.replace(vehicle, hand_over=dataclasses.replace(start, port_distance_m=distance))


def drawn_once(vehicle: Vehicle, scenario: VehicleScenario) -> dict[str, int]:
    """What is drawn once a run, of the kinds that are uncertain: names, and how many numbers each has."""
    flown = as_flown(vehicle, scenario)
    start, thrust = flown.hand_over, flown.thrust
    sizes = {
        "start": (start.position_sigma_m, 3),
        "velocity": (start.velocity_sigma_m_s, 3),
        "speed": (scenario.spread.speed_relative_sigma, 1),
        "chaser_attitude": (start.chaser_attitude_sigma_rad, 3),
        "target_attitude": (start.target_attitude_sigma_rad, 3),
        "target_rate": (start.target_rate_sigma_rad_s, 3),
        "thrust_scale": (thrust.scale_sigma, 1),
        "thrust_turn": (thrust.direction_sigma_rad, 3),
        "gyro_bias": (flown.gyro.bias_sigma_rad_s, 3),
        "gyro_scale": (flown.gyro.scale_sigma, 3),
        "gyro_misalignment": (flown.gyro.misalignment_sigma_rad, 6),
    }
    for name, mounted in flown.sensor.items():
        sizes[f"{name}.mount"] = mounted.mount_sigma_rad, 3
        if flown.kind(name) == POINTS:
            sizes[f"{name}.lever"] = mounted.lever_sigma_m, 3
            sizes[f"{name}.focal"] = mounted.focal_sigma, 1
            sizes[f"{name}.points"] = mounted.points_sigma_m, 3 * flown.new_lights(name)
    return {name: count for name, (sigma, count) in sizes.items() if sigma > 0.0 and count}


def fly_vehicle_run(
    vehicle: Vehicle, scenario: VehicleScenario, seed: int, run: int, given: Mapping[str, float] | None = None
) -> tuple[VehicleRun, dict[str, float]]:
    """Fly a run; with what was drawn once for it, in units of its 1-sigma. given: replaces these, by name.

    Observations come in the order in which a filter is to take them: that of time, unless a fault has a sensor late.
    """
    check_vehicle_scenario(vehicle, scenario)
    numbers = OfRun(seed, run, list(vehicle.sensor), given)
    faster = 1.0 + scenario.spread.speed_relative_sigma * float(numbers.once("speed", 1)[0])
    approach = scenario.approach
    flight = dataclasses.replace(approach, fast_m_s=faster * approach.fast_m_s, slow_m_s=faster * approach.slow_m_s)
    flown = simulate_rendezvous(as_flown(vehicle, scenario), flight, numbers=numbers)
    fault = scenario.fault
    if fault.sensor != "none" and Draws(seed, run).uniforms(Stream.LOSS, (1,))[0] < fault.probability:
        kind, rng = FAULTS[fault.kind], numbers.noise("fault")
        observations = with_fault(flown, kind, fault.sensor, rng, fault.from_s, fault.for_s)
        flown = flown.having(observations, in_time=kind != VehicleFault.LATE)
    else:
        flown = dataclasses.replace(flown, in_time=True)
    return flown, numbers.drawn_by_number()
