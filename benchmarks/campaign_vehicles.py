"""How many approaches of a vehicle, or flights of markers, a campaign flies an hour: truth, sensors, filter and score.

    python benchmarks/campaign_vehicles.py [--model rendezvous_demo] [--runs 12]

Processor time of one process, run by run, of which minimum and median are told: on a busy machine the minimum says most.
Then approaches an hour for so many cores, at the median and at the minimum.
"""

import argparse
import statistics
import time

import relnav
from relnav.accuracy.campaign_plan import fly_batch
from relnav.files.campaign import plan_of, processors


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="rendezvous_demo")
    parser.add_argument("--runs", type=int, default=12)
    options = parser.parse_args()
    plan = plan_of(relnav.load_model(options.model), None, None, 1, options.runs)
    fly_batch(plan, range(1))
    times = []
    for run in range(options.runs):
        began = time.process_time()
        fly_batch(plan, range(run, run + 1))
        times.append(time.process_time() - began)
    cores, least, middle = processors(), min(times), statistics.median(times)
    print(f"{options.model}: {least:.2f} s of processor time a run (median {middle:.2f})")
    print(f"an hour on {cores} cores: {3600.0 * cores / least:.0f} (median {3600.0 * cores / middle:.0f})")


if __name__ == "__main__":
    main()
