"""Compare with a paper: measure a sensor system against truth and set it beside what its paper claims.

python examples/compare_with_a_paper.py [MODEL [RUNS]]
"""

import sys

import relnav


def main(model: str = "birefringent_sun", runs: int = 200) -> None:
    """Print every claim with the figure measured, and whether it came out as expected."""
    report = relnav.measure_accuracy(model, runs=int(runs))
    for row in report.rows:
        came = "met" if row.met else "not met"
        print(f"{row.quantity}, {row.method}: published {row.published:g} {row.unit}, {row.measured:.3g}: {came}")
    print("every row as expected:", report.ok)


if __name__ == "__main__":
    main(*sys.argv[1:])
