"""The accuracy benchmark against the papers, as a script: tables, JSON and a picture.

    python benchmarks/accuracy.py --runs 200 --out results

The same as `relnav accuracy MODEL`, for every shipped model.
"""

import argparse
import sys
from pathlib import Path

import relnav
from relnav.cli import run


def main() -> int:
    """Measure every shipped model; returns the worst exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--out", type=Path, default=Path("."))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    worst = 0
    for model in relnav.list_models():
        arguments = ["--seed", str(options.seed), "--json", str(options.out / f"{model}.json")]
        if isinstance(relnav.load_model(model), relnav.Model):  # others have their own number of runs, and no picture
            arguments += ["--runs", str(options.runs), "--plot", str(options.out / f"{model}.png")]
        worst = max(worst, run(["accuracy", model, *arguments]))
    return worst


if __name__ == "__main__":
    sys.exit(main())
