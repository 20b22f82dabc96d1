"""A vehicle's filter that is locked out: how soon it can be used again, and whether it is right then.

    python benchmarks/vehicle_lockout.py --runs 100

From 10 to 5 m; what goes wrong goes wrong for all lights at once. Back: seconds from the fault's beginning, of a lie
its end, until the estimate is right and usable for good. Unsaid: the most seconds of a run in which the port is off by
more than its protection level, and nothing says so: at the start, and after a jump, that is until the images are taken
for refused. NEES of the port's twelve errors, over twelve. Exit code 1 if a run does not come back or is off without a
word for longer than `restart_after_s`.
"""

import argparse

import numpy as np

import relnav
from relnav.accuracy.vehicle_lockout import LockOut, fly_lockout


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    vehicle, bad = relnav.load_model("rendezvous_demo"), 0
    print("what goes wrong" + " " * 22 + "searches  back          median  95 %  longest  unsaid  NEES/n  10 s later")
    for kind in LockOut:
        runs = [fly_lockout(vehicle, kind, arguments.seed * 100_000 + k) for k in range(arguments.runs)]
        back = [one for one in runs if one.back_s == one.back_s]
        times, unsaid = np.array([one.back_s for one in back]), max(one.unsaid_s for one in runs)
        bad += unsaid > vehicle.filter.restart_after_s or len(back) < len(runs)
        then, later = (np.nanmean([getattr(one, name) for one in back]) / 12.0 for name in ("nees_back", "nees_later"))
        middle, most = np.quantile(times, (0.5, 0.95), method="higher")
        print(
            f"{kind:36s} {sum(one.restarts for one in runs) / len(runs):8.1f} {len(back):4d} of {len(runs):<4d}"
            f"{middle:6.0f} s {most:3.0f} s {times.max():6.0f} s {unsaid:5d} s {then:7.2f} {later:11.2f}"
        )
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
