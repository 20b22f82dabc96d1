"""How fast a campaign is: run-epochs with truth, noise, faults, filter and NEES, beside a filterpy loop's filter alone.

    python benchmarks/campaign_speed.py --out campaign_speed.json
    python benchmarks/campaign_speed.py --parts                      what an epoch is made of, one thread

With NUMBA_CACHE_DIR set to an empty folder the first line says what it takes to compile.

One thread and as many as there are processors, in one process, in turn with the filterpy user of `speed.py`, whose
answers are checked there, and who only filters spots that are at hand. Processor time of a thread for one thread, wall
time for several; minimum and median of the rounds. Only the ratios mean anything on another machine.
"""

import argparse
import json
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from speed import Problem

import relnav
from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.accuracy.run_score import RunScorer
from relnav.codegen.together import RUNS
from relnav.files.workers import processors
from relnav.simulation.dispersed import fly_runs
from relnav.simulation.dispersions import Images, Scenario, Spread, Thrust
from relnav.simulation.run_draws import disturbed
from relnav.simulation.streams import Draws
from relnav.simulation.trajectory import Approach, fly_together

BATCH = 200
"""Runs of a round, for each thread."""
SCENARIOS = {
    "two-body truth": Scenario(Approach(duration_s=250.0)),
    "assumed noise": Scenario(Approach(duration_s=250.0, assumed_noise=True)),
    "assumed noise, spreads, faults": Scenario(
        Approach(duration_s=250.0, assumed_noise=True),
        Spread((0.5, 0.1, 0.1), (0.005, 0.005, 0.005), 0.05),
        Thrust(0.01, 0.01),
        Images(dropout=0.01, outliers=0.002),
    ),
}


def parts(model, scenario, method, rounds):
    """Processor time of truth, images, filter and figures of runs flown together, us an epoch: the least each."""
    scorer, times, none = RunScorer(model, scenario, method, 1), [], [None] * RUNS
    for first in range(0, rounds * RUNS, RUNS):
        runs, clock = range(first, first + RUNS), [time.thread_time()]
        fly_together(model, [disturbed(model, scenario, Draws(1, run), {}) for run in runs])
        clock.append(time.thread_time())
        flights = fly_runs(model, scenario, 1, runs, none)
        clock.append(time.thread_time())
        logs = scorer.filtered(flights)
        clock.append(time.thread_time())
        scorer.scored(flights, logs)
        clock.append(time.thread_time())
        times.append(np.diff(clock) / flights.truth.size * 6.0 * 1e6)
    truth, flown, *rest = np.min(times, axis=0)
    return truth, flown - truth, *rest


def _batch(plan, k):
    return fly_batch(plan, range(BATCH * k, BATCH * (k + 1)), together=True)


def main() -> None:
    """Measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--parts", action="store_true")
    options = parser.parse_args()
    if options.parts:
        print(f"{'us a run-epoch, the least':<44}{'truth':>8}{'images':>8}{'filter':>8}{'figures':>8}")
        for name, scenario in SCENARIOS.items():
            for method in ("spots", "fix"):
                each = parts(relnav.load_model("three_beacon_psd"), scenario, method, options.rounds)
                print(f"{f'{name}, {method}':<44}" + "".join(f"{value:8.2f}" for value in each))
        return
    model, (peer_epochs, peer) = relnav.load_model("three_beacon_psd"), Problem().peers()["filterpy user"]
    threads = processors()
    plans = {
        (name, method): Plan(model, scenario, method, 1, BATCH * threads)
        for name, scenario in SCENARIOS.items()
        for method in ("spots", "fix")
    }
    epochs = 2500 * BATCH
    alone = {key: [] for key in plans}
    together = {key: [] for key in plans}
    theirs = []
    clock = [time.process_time()]
    for plan in plans.values():
        for as_one in (False, True):
            fly_batch(plan, range(RUNS), together=as_one)
            clock.append(time.process_time())
    first, eight = np.diff(clock)[:2]
    print(f"first runs {first:.0f} s, then eight together {eight:.0f} s, with compilation where it was not at hand")
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(options.rounds):
            began = time.thread_time()
            peer()
            theirs.append((time.thread_time() - began) / peer_epochs * 1e6)
            for key, plan in plans.items():
                began = time.thread_time()
                fly_batch(plan, range(BATCH), together=True)
                alone[key].append((time.thread_time() - began) / epochs * 1e6)
                began = time.perf_counter()
                list(pool.map(lambda k, plan=plan: _batch(plan, k), range(threads)))
                together[key].append((time.perf_counter() - began) / (epochs * threads) * 1e6)
    print(f"filterpy user: {min(theirs):.0f} us an epoch (median {statistics.median(theirs):.0f})")
    heads = f"{'one thread':>16}{'ratio':>7}{f'{threads} threads, wall':>20}{'ratio':>7}"
    print(f"{'us a run-epoch: minimum (median)':<44}{heads}")
    rows = []
    for (name, method), one in alone.items():
        many = together[name, method]
        row = {"scenario": name, "method": method, "threads": threads}
        row |= {"one_us": min(one), "one_us_median": statistics.median(one)}
        row |= {"many_us": min(many), "many_us_median": statistics.median(many), "filterpy_us": min(theirs)}
        rows.append(row)
        said = [f"{min(times):.2f} ({statistics.median(times):.2f})" for times in (one, many)]
        ratios = [f"{min(theirs) / min(times):.0f}" for times in (one, many)]
        print(f"{f'{name}, {method}':<44}{said[0]:>16}{ratios[0]:>7}{said[1]:>20}{ratios[1]:>7}")
    if options.out is not None:
        options.out.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
