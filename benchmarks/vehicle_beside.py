"""The same pieces of a flight of the shipped vehicle in two checkouts by turns: what one took beside the other.

    python benchmarks/vehicle_beside.py --other ../relnav-before

A busy machine's speed changes by a factor within a minute; two processes that fly the same two seconds one after the
other see the same machine, so that the median of their ratios holds to a per cent or two. Processor time; the other's
comes first in every second piece. Last, how far apart the two estimates are at the end, in 1-sigma.
"""

import argparse
import operator
import os
import subprocess
import sys
import time
from itertools import groupby
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[1]
PIECE_S = 2.0


FILTERS = {
    "one": {"monitor": False},
    "both": {},
    "all": {"separation": True},
}
"""Without the filter that watches; with it; with one without each sensor as well."""


def fly(seed: int, comes: str, filters: str) -> None:
    """Fly a piece for every line that comes in, and print ms of processor time a second of flight; last, the end."""
    import relnav
    from relnav.simulation.vehicle_sensors import simulate_rendezvous

    vehicle = relnav.load_model("rendezvous_demo")
    flight = sorted(simulate_rendezvous(vehicle, seed=seed).observations, key=operator.attrgetter(comes))
    pieces = [list(part) for _, part in groupby(flight, key=lambda seen: getattr(seen, comes) // PIECE_S)][:-1]
    warm, nav = (relnav.VehicleNavigator(vehicle, **FILTERS[filters]) for _ in range(2))
    for seen in flight[:1000]:
        warm.observe(seen.sensor, seen.t_s, seen.value)
    print(len(pieces), flush=True)
    for piece, _ in zip(pieces, sys.stdin, strict=False):
        begin = time.thread_time()
        for seen in piece:
            nav.observe(seen.sensor, seen.t_s, seen.value)
        print(1e3 * (time.thread_time() - begin) / PIECE_S, flush=True)
    end = nav.state()
    print(*(float(x) for x in (*end.values, *np.sqrt(np.diagonal(end.covariance)))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path, help="the other checkout")
    parser.add_argument("--order", choices=["time", "arrival"], default="time")
    parser.add_argument(
        "--filters", choices=list(FILTERS), default="both", help="one, with the one that watches, or all"
    )
    parser.add_argument("--other-filters", choices=list(FILTERS), help="of the other checkout; the same if left out")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--fly", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.fly:
        fly(given.seed, {"time": "t_s", "arrival": "arrives_s"}[given.order], given.filters)
        return
    if given.other is None or not (given.other / "relnav").is_dir():
        parser.error("--other is the folder of another checkout of relnav")
    call = [sys.executable, __file__, *sys.argv[1:], "--fly"]
    flyers = [
        subprocess.Popen(
            [*call, "--filters", filters],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(tree)},
        )
        for tree, filters in ((given.other.resolve(), given.other_filters or given.filters), (HERE, given.filters))
    ]
    pieces, _ = (int(flyer.stdout.readline()) for flyer in flyers)
    spent = np.empty((pieces, 2))
    for k in range(pieces):
        for j in (0, 1) if k % 2 else (1, 0):
            flyers[j].stdin.write("\n")
            flyers[j].stdin.flush()
            spent[k, j] = float(flyers[j].stdout.readline())
    for flyer in flyers:
        flyer.stdin.close()
    ends = np.array([[float(x) for x in flyer.stdout.readline().split()] for flyer in flyers]).reshape(2, 2, -1)
    for flyer in flyers:
        flyer.wait()
    for name, one in zip(("the other", "this one"), spent.T, strict=True):
        print(f"{name}: {np.median(one):.2f} ms of processor time for a second of flight, {one.min():.2f} at the least")
    print(f"this one over the other: {np.median(spent[:, 1] / spent[:, 0]):.2f}, of {pieces} pieces by turns")
    print(f"estimates at the end: {np.abs((ends[1, 0] - ends[0, 0]) / ends[1, 1]).max():.1g} sigma apart")


if __name__ == "__main__":
    main()
