"""What more threads, or more processes of a local cluster, buy: whole campaigns of beacons, from call to summary.

    python benchmarks/campaign_scaling.py [--runs 20000] [--most 2] [--rounds 3]

Wall time of `relnav.campaign(..., out=FOLDER)`, that is with processes started, parts written, summary and pictures;
the least of the rounds, the ways by turns. Needs the extras `parquet`, `plot` and `cluster`. What has to be compiled is
compiled before.
"""

import argparse
import tempfile
import time
from pathlib import Path

import relnav
from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.codegen.together import RUNS
from relnav.simulation.dispersions import Images, Scenario, Spread, Thrust
from relnav.simulation.trajectory import Approach

SCENARIO = Scenario(
    Approach(duration_s=250.0), Spread((0.5, 0.1, 0.1)), Thrust(0.01, 0.01), Images(dropout=0.01, outliers=0.002)
)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--most", type=int, default=2, help="threads, and workers")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    model = relnav.load_model("three_beacon_psd")
    fly_batch(Plan(model, SCENARIO, "fix", 1, options.runs), range(RUNS), together=True)
    counts = [count for count in (1, 2, 4, 8, 16, 32, 64) if count <= options.most]
    ways = [(cluster, count) for cluster in (None, "local") for count in counts]
    took: dict[tuple[str | None, int], list[float]] = {way: [] for way in ways}
    for _ in range(options.rounds):
        for cluster, count in ways:
            with tempfile.TemporaryDirectory() as folder:
                out, began = Path(folder) / "flown", time.perf_counter()
                relnav.campaign(
                    model, options.runs, 1, dispersions=SCENARIO, method="fix", out=out, workers=count, cluster=cluster
                )
                took[cluster, count].append(time.perf_counter() - began)
    print(f"{options.runs} runs of {round(SCENARIO.approach.duration_s * SCENARIO.approach.rate_hz)} images")
    for (cluster, count), times in took.items():
        one, more = ("thread", "threads") if cluster is None else ("process", "processes")
        name = f"{count} {one if count == 1 else more}{'' if cluster is None else ' of a local cluster'}"
        print(f"{name:<32}{min(times):7.1f} s{options.runs / min(times):8.0f} runs a second")


if __name__ == "__main__":
    main()
