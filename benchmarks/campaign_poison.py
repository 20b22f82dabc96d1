"""Campaigns on a local cluster in which some runs kill their process: they are named, and the others complete.

    python benchmarks/campaign_poison.py [--campaigns 3] [--runs 64]

Which runs kill (SIGKILL to their own process) is drawn anew for each campaign. Of the folder: `failed.parquet` names
these runs and no other, and every other row is that of the campaign without.
"""

import argparse
import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import relnav
from relnav.accuracy import run_score
from relnav.simulation.dispersions import Scenario, Spread
from relnav.simulation.trajectory import Approach

SCENARIO = Scenario(Approach(duration_s=10.0), Spread((0.3, 0.1, 0.1)))
POISON = "RELNAV_BENCHMARK_POISON"
_fly = getattr(run_score, "fly_run_without_poison", run_score.fly_run)  # this file may be loaded twice


def _poisoned(model, scenario, seed, run, given=None):
    """As `fly_run`, but for runs that kill."""
    if str(run) in os.environ.get(POISON, "").split(","):
        os.kill(os.getpid(), signal.SIGKILL)
    return _fly(model, scenario, seed, run, given)


run_score.fly_run_without_poison = _fly
run_score.fly_run = _poisoned  # in every worker too: it loads this file before anything else
os.environ["DASK_DISTRIBUTED__WORKER__PRELOAD"] = repr([str(Path(__file__).resolve())])


def main() -> None:
    """Fly, compare, say what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=3)
    parser.add_argument("--runs", type=int, default=64)
    options = parser.parse_args()
    rng, good = np.random.default_rng(0), True
    whole = relnav.campaign("three_beacon_psd", options.runs, 3, dispersions=SCENARIO, workers=1).to_pydict()
    for _ in range(options.campaigns):
        bad = sorted(rng.choice(np.arange(1, options.runs), size=int(rng.integers(1, 4)), replace=False).tolist())
        os.environ[POISON] = ",".join(map(str, bad))
        with tempfile.TemporaryDirectory() as name:
            began = time.monotonic()
            out = Path(name) / "out"
            flown = relnav.campaign(
                "three_beacon_psd", options.runs, 3, dispersions=SCENARIO, out=out, workers=2, cluster="local"
            ).to_pydict()
            from pyarrow import parquet

            named = parquet.read_table(out / "failed.parquet").column("run").to_pylist()
        del os.environ[POISON]
        others = [k for k in range(options.runs) if k not in bad]
        same = all(
            np.array_equal([flown[key][k] for k in others], [whole[key][k] for k in others], equal_nan=key != "reason")
            for key in whole
        )
        good = good and named == bad and same
        took = time.monotonic() - began
        print(f"killers {bad}: named {named}; others {'the same' if same else 'OTHER'}; {took:.0f} s", flush=True)
    sys.exit(0 if good else 1)


if __name__ == "__main__":
    main()
