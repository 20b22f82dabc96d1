"""What simulations and campaigns refuse, and in which words: a line for each message that no other test triggers."""

import dataclasses

import numpy as np
import pytest

import relnav

PSD = relnav.load_model("three_beacon_psd")
VEHICLE = relnav.load_model("rendezvous_demo")


def bare(model, *sections):
    return dataclasses.replace(model, **dict.fromkeys(sections))


def four_beacons():
    return dataclasses.replace(PSD, sensor=dataclasses.replace(PSD.sensor, extra_beacons_m=((0.0, 0.5, 0.5),)))


def dispersed():
    from relnav.simulation.dispersed import fly_run
    from relnav.simulation.dispersions import AsBuilt, Scenario

    return fly_run(bare(PSD, "tolerances"), Scenario(as_built=AsBuilt(by_tolerances=True)), 1, 0)


def raw(model):
    from relnav.simulation.raw import simulate_raw

    return simulate_raw(model)


def faults_without_times():
    from relnav.simulation.raw import slot_counts

    rng = np.random.default_rng(1)
    return slot_counts(PSD, np.zeros((3, 6)), np.arange(3), rng, faults=(None,))


def rendezvous_that_flees():
    from relnav.simulation.rendezvous import Rendezvous

    return Rendezvous(fast_m_s=-1.0)


def vehicle_without_sensors():
    return dataclasses.replace(VEHICLE, sensor={})


def plan(**changes):
    from relnav.accuracy.campaign_plan import Plan
    from relnav.simulation.dispersions import Scenario

    return Plan(**({"model": PSD, "scenario": Scenario(), "method": "fix", "seed": 1, "runs": 2} | changes))


def too_many_approaches():
    from relnav.accuracy.campaign import run_campaign
    from relnav.simulation.trajectory import Approach

    return run_campaign(PSD, Approach(), (), 10**9, 1)


def one_run(which):
    from relnav.accuracy import faults, report

    if which == "faults":
        return faults.fly_faults([], None, (), (), {}, 1, 7, None)
    return report.measure(PSD, relnav.load_published("three_beacon_psd"), runs=1)


CALLS = {
    "scenario": (lambda: plan(scenario="windy"), r"a scenario is expected, relnav.load_scenario\(...\); got a str"),
    "no run": (lambda: plan(runs=0), "runs is 1 or more and below .*; got 0"),
    "no method": (lambda: plan(method="spot"), 'method must be "spots" or "fix"; got \'spot\''),
    "too many": (too_many_approaches, "runs must be .* or fewer, as seeds lie so far apart; got 1000000000"),
    "one fault": (lambda: one_run("faults"), "runs must be 2 or more; got 1"),
    "one approach": (lambda: one_run("report"), "runs must be 2 or more; got 1"),
    "dispersed": (dispersed, r"has no \[tolerances\], by which the scenario draws the sensor as built"),
    "raw": (lambda: raw(bare(PSD, "pulses")), r"has no \[detector\], \[light\] and \[pulses\]: raw logs need"),
    "raw of four": (lambda: raw(four_beacons()), "raw logs hold beacons a, b, c; model three_beacon_psd lists 4"),
    "times": (faults_without_times, r"faults happen at times: t_s \(n,\) is needed with them"),
    "rendezvous": (rendezvous_that_flees, "closing rates are positive; got -1.0"),
    "no sensor": (vehicle_without_sensors, r"a vehicle has sensors: write one section \[sensor.NAME\] for each"),
}


@pytest.mark.parametrize(("call", "message"), CALLS.values(), ids=CALLS)
def test_a_call_says_what_it_refuses(call, message):
    with pytest.raises((ValueError, TypeError, relnav.UsageError), match=message):
        call()
