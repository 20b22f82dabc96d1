"""Filter a log of spots: read it, filter and smooth it, look at the answer, write it.

python examples/filter_your_log.py [LOG.csv [MODEL]]
"""

import sys
from pathlib import Path

import numpy as np

import relnav

FLOWN = Path(__file__).parent / "basilisk_approach" / "vbar_log.csv"


def main(log: str | Path = FLOWN, model: str = "three_beacon_psd") -> None:
    """Print what the filter made of a log; write track.csv beside you."""
    mission = relnav.load_model(model)
    solution = relnav.filter_log(log, mission)
    known = np.flatnonzero(np.isfinite(solution.state[:, 0]))  # NaN until the filter has started
    last = int(known[-1])
    x, y, z = solution.state[last, :3]
    sigma = 1e3 * solution.covariance[last].diagonal()[:3] ** 0.5
    print(f"{len(solution.t_s)} images, {len(known)} with a state")
    print(f"at {solution.t_s[last]:.1f} s: x {x:.3f} m, y {y:.3f} m, z {z:.3f} m from the target")
    print(f"1-sigma {sigma[0]:.1f} mm, {sigma[1]:.1f} mm, {sigma[2]:.1f} mm")
    print(solution.nis_consistency())
    relnav.write(solution, "track.csv")


if __name__ == "__main__":
    main(*sys.argv[1:])
