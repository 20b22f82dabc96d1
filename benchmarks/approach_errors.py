"""Errors of the example approach against its truth after 50 s: the table of the README.

python benchmarks/approach_errors.py
"""

import numpy as np
from approach_picture import EXAMPLE, QUANTITIES, true_docking

import relnav

SETTLED_S = 50.0


def main() -> None:
    """Filter the example by both methods and print root mean square errors and consistency."""
    table = np.loadtxt(EXAMPLE / "vbar_truth.csv", delimiter=",", skiprows=1)
    claims = {claim.quantity: claim for claim in relnav.load_published("three_beacon_psd").claims}
    for method in ("fix", "spots"):
        solution = relnav.filter_log(EXAMPLE / "vbar_log.csv", "three_beacon_psd", method=method)
        late = solution.t_s > SETTLED_S
        docking = np.sqrt(np.mean((solution.docking - true_docking(table))[late] ** 2, axis=0))
        error = (solution.state - table[:, 1:])[late]
        state = np.sqrt(np.mean(error**2, axis=0))
        nees = np.einsum("ni,ni->n", error, np.linalg.solve(solution.covariance[late], error[..., None])[..., 0])
        print(f"method {method}, {int(late.sum())} epochs after {SETTLED_S:g} s")
        for row, (quantity, unit, scale) in enumerate(QUANTITIES):
            published = claims[quantity].value
            reached = docking[row] * scale
            print(f"  {quantity:<10} rms {reached:.4f} {unit:<4} published {published:g} {unit}")
        print(f"  position   rms {np.array2string(state[:3] * 1e3, precision=2)} mm")
        print(f"  velocity   rms {np.array2string(state[3:] * 1e3, precision=3)} mm/s")
        print(f"  mean NEES {nees.mean():.2f} (6 for a correct covariance)\n  {solution.nis_consistency()}")


if __name__ == "__main__":
    main()
