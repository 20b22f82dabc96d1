"""Fly a campaign: many approaches with what is uncertain drawn anew, and whether the covariance is honest.

python examples/fly_a_campaign.py [RUNS]
"""

import sys
from pathlib import Path

import numpy as np

import relnav

SCENARIO = Path(__file__).parent / "campaign" / "vbar.toml"


def main(runs: int = 16) -> None:
    """Print the spread of the error at the end of the runs beside what the filter says of it."""
    scenario = relnav.load_scenario(SCENARIO, {"approach.duration_s": 60.0})
    table = relnav.campaign("three_beacon_psd", runs=int(runs), seed=7, dispersions=scenario)
    nees = np.array(table.column("final_nees"))
    print(f"{table.num_rows} runs, all flown: {set(table.column('status').to_pylist()) == {0}}")
    print(f"mean NEES at the end {nees.mean():.1f}; a correct covariance gives 6 +- {np.sqrt(12.0 / len(nees)):.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
