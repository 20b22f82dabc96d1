"""Faults of chosen sensors of the shipped vehicle: the rows that `relnav accuracy --faults` prints of them.

    python benchmarks/vehicle_faults.py thrust --runs 100
    python benchmarks/vehicle_faults.py gyro camera psd star thrust --runs 100 --size 0.25

What the figures mean: docs/vehicle.md, Integrity. Exit code 1 if a bar is not met.
"""

import argparse

import relnav
from relnav.accuracy.vehicle_faults import measure_faults
from relnav.spacecraft import RESERVED


def main() -> int:
    vehicle = relnav.load_model("rendezvous_demo")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sensors", nargs="+", choices=["none", *RESERVED, *vehicle.sensor], help="none: no fault")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--size", type=float, default=1.0, help="of ramps, jumps and faults of thrusters, a multiple")
    given = parser.parse_args()
    only = {"" if name == "none" else name for name in given.sensors}
    report = measure_faults(vehicle, runs=given.runs, seed=given.seed, only=only, size=given.size)
    print("\n".join(report.lines()))
    return 0 if report.ok else 1


if __name__ == "__main__":
    raise SystemExit(main())
