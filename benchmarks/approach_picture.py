"""Draw the example approach: errors of the filtered track and its 1-sigma, beside the published figures.

    python benchmarks/approach_picture.py --out docs/approach.png

Truth is that of the flight simulator that made the log, so this is an error, not a residual.
"""

import argparse
from pathlib import Path

import numpy as np

import relnav

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "basilisk_approach"
QUANTITIES = (("range", "m", 1.0), ("azimuth", "deg", 180.0 / np.pi), ("elevation", "deg", 180.0 / np.pi))


def true_docking(truth: np.ndarray) -> np.ndarray:
    """Range, azimuth, elevation of true positions; the example's docking frame is parallel to lvlh_ccsds."""
    x, y, z = truth[:, 1], truth[:, 2], truth[:, 3]
    return np.stack([np.sqrt(x * x + y * y + z * z), np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))], axis=1)


def main() -> None:
    """Filter the example by both methods and save the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("approach.png"))
    out = parser.parse_args().out
    truth = true_docking(np.loadtxt(EXAMPLE / "vbar_truth.csv", delimiter=",", skiprows=1))
    claims = {claim.quantity: claim for claim in relnav.load_published("three_beacon_psd").claims}
    figure, axes = plt.subplots(3, 2, figsize=(10, 6.5), sharex=True, sharey="row", layout="constrained")
    for column, method in enumerate(("fix", "spots")):
        solution = relnav.filter_log(EXAMPLE / "vbar_log.csv", "three_beacon_psd", method=method)
        error, sigma = np.abs(solution.docking - truth), solution.docking_sigma
        for row, (quantity, unit, scale) in enumerate(QUANTITIES):
            axis = axes[row, column]
            axis.semilogy(solution.t_s, error[:, row] * scale, ",", color="0.45", label="|error|")
            axis.semilogy(solution.t_s, sigma[:, row] * scale, color="C0", label="reported 1-sigma")
            claim = claims[quantity]
            axis.axhline(claim.value, color="C3", ls="--", label=f"published {claim.value:g} {unit}")
            axis.set_ylim(1e-5, 1.0)
            axis.grid(alpha=0.3)
            axis.set_ylabel(f"{quantity}, {unit}" if column == 0 else "")
            axis.legend(loc="upper right", fontsize=7, ncols=3)
        axes[0, column].set_title(f"method {method}")
        axes[2, column].set_xlabel("time, s")
    figure.savefig(out, dpi=110)
    print(f"picture: {out}")


if __name__ == "__main__":
    main()
