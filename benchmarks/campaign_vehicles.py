"""How many approaches of a vehicle, or flights of markers, a campaign flies an hour: truth, sensors, filter and score.

    python benchmarks/campaign_vehicles.py [--model rendezvous_demo] [--runs 12]

Processor time of one process, run by run in turn with the filterpy user of `speed.py`, whose epoch is the measure of
how busy the machine is: minimum and median, and approaches an hour for so many cores.
"""

import argparse
import gc
import statistics
import time

from speed import Problem

import relnav
from relnav.accuracy.campaign_plan import fly_batch
from relnav.files.campaign import plan_of
from relnav.files.workers import processors


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="rendezvous_demo")
    parser.add_argument("--runs", type=int, default=12)
    options = parser.parse_args()
    plan = plan_of(relnav.load_model(options.model), None, None, 1, options.runs)
    fly_batch(plan, range(1))
    gc.freeze()  # as every process of a campaign begins
    times, theirs = [], []
    epochs, peer = Problem().peers()["filterpy user"]
    for run in range(options.runs):
        began = time.process_time()
        peer()
        theirs.append((time.process_time() - began) / epochs)
        began = time.process_time()
        fly_batch(plan, range(run, run + 1))
        times.append(time.process_time() - began)
    cores, least, middle = processors(), min(times), statistics.median(times)
    print(f"{options.model}: {least:.2f} s of processor time a run (median {middle:.2f})")
    ratio = statistics.median(one / other for one, other in zip(times, theirs, strict=True))
    print(f"as long as {ratio:.0f} epochs of filterpy, which take {1e6 * min(theirs):.0f} us")
    print(f"an hour on {cores} cores: {3600.0 * cores / least:.0f} (median {3600.0 * cores / middle:.0f})")


if __name__ == "__main__":
    main()
