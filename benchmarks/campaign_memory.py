"""How much memory the driver of a campaign needs as runs grow: parts are there, it sums them up and draws.

    python benchmarks/campaign_memory.py [--runs 100000 1000000]

One batch is flown and written under the names of all batches, so that a folder of a million runs is at hand in a
minute; then a process of its own does what the driver does at the end. Its largest resident size is told, and what
imports take of it. On a cluster the driver holds four futures a worker beside, and no results.
"""

import argparse
import dataclasses
import subprocess
import sys
import tempfile
from pathlib import Path

import relnav
from relnav.accuracy.campaign_plan import fly_batch
from relnav.files.campaign import plan_of
from relnav.files.campaign_folder import open_folder, write_flown
from relnav.simulation.dispersions import Scenario, Spread
from relnav.simulation.trajectory import Approach

SCENARIO = Scenario(Approach(duration_s=25.0), Spread((0.3, 0.1, 0.1)))
DRIVER = """
import resource, sys
import relnav
from relnav.files.campaign import finish, fly_missing, plan_of
from benchmarks_scenario import SCENARIO
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if sys.argv[1] != "0":
    from pathlib import Path
    plan = plan_of(relnav.load_model("three_beacon_psd"), SCENARIO, None, 3, int(sys.argv[1]))
    fly_missing(plan, Path(sys.argv[2]), 2, None, None)
    finish(plan, Path(sys.argv[2]))
print(before / 1024.0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, nargs="*", default=[100_000, 1_000_000])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        source = Path(__file__).read_text(encoding="utf-8")
        kept = [line for line in source.splitlines() if line.startswith(("SCENARIO", "from relnav.simulation"))]
        (place / "benchmarks_scenario.py").write_text("\n".join(sorted(kept, key=lambda line: line[0] == "S")) + "\n")
        flown = None
        for runs in options.runs:
            plan = plan_of(relnav.load_model("three_beacon_psd"), SCENARIO, None, 3, runs)
            folder = place / str(runs)
            open_folder(folder, plan)
            for start in plan.starts:
                if flown is None or len(flown.run) != len(plan.runs_of(start)):
                    flown = fly_batch(plan, plan.runs_of(start))
                write_flown(plan, folder, dataclasses.replace(flown, run=flown.run - flown.run[0] + start))
            size = sum(path.stat().st_size for path in folder.rglob("*")) / 1e6
            words = [sys.executable, "-c", DRIVER, str(runs), str(folder)]
            said = subprocess.run(words, check=True, capture_output=True, text=True, cwd=place).stdout.split()
            print(
                f"{runs} runs, {len(plan.starts)} parts, {size:.0f} MB on disk: driver {float(said[1]):.0f} MB, "
                f"of which {float(said[0]):.0f} MB are imports",
                flush=True,
            )


if __name__ == "__main__":
    main()
