"""The files of `fuzzing.py`, its targets and its faults, led by the lines of the readers that they reach.

`atheris` (of PyPI) exchanges the bytes that stand for chance in the mutators, and goes on from those with which a file
reached something new in `relnav.files`.

    python benchmarks/fuzzing_coverage.py [--cases 1000] [--inputs 1000000] [--target models] [--json FILE]

Without `atheris` it says so; `fuzzing.py --inputs N` then tries files of a seed.
"""

import importlib
import random
import sys
from pathlib import Path
from typing import Any

MOST_BYTES = 4096
"""Of chance for one file."""


class Told(random.Random):
    """Chance as bytes say; once they are used up, always the least."""

    def __init__(self, provider: Any) -> None:
        super().__init__(0)
        self._provider = provider

    def random(self) -> float:
        """Of 65,536 values, from 0 up to 1."""
        return float(self._provider.ConsumeIntInRange(0, 65_535)) / 65_536

    def randbytes(self, n: int) -> bytes:
        """As they come."""
        return bytes(self._provider.ConsumeBytes(n)).ljust(n, b"\x00")


def main() -> None:
    """Run and report, as `fuzzing.py` does."""
    try:
        atheris = importlib.import_module("atheris")
    except ImportError:
        sys.exit("atheris is not installed (pip install atheris); benchmarks/fuzzing.py --inputs N needs none")
    root = Path(__file__).parents[1] / "relnav"
    paths = (path.relative_to(root.parent).with_suffix("") for path in root.rglob("*.py"))
    names = (".".join(path.parts).removesuffix(".__init__") for path in paths)
    others = [name for name in names if not name.startswith("relnav.files")]  # formulas are compiled, not traced
    with atheris.instrument_imports(include=["relnav.files"], exclude=others, enable_loader_override=False):
        fuzzing = importlib.import_module("fuzzing")
    choices = importlib.import_module("fuzzing_choices")

    def fuzz(name: str, folder: Path, cases: int, *, number: int = 0) -> dict[str, Any]:
        def part(trial: Any, begin: int, answer: Any) -> None:
            case = begin

            def one(data: bytes) -> None:
                nonlocal case
                if case == cases:
                    answer(trial.entry(cases))
                trial.take(case, choices.Seeded(Told(atheris.FuzzedDataProvider(data))))
                case += 1

            options = [f"-seed={number * 1_000_003 + begin + 1}", f"-max_len={MOST_BYTES}", "-len_control=0"]
            atheris.Setup(
                [sys.argv[0], *options, f"-artifact_prefix={folder}/", "-rss_limit_mb=0", "-timeout=0", "-verbosity=0"],
                one,
            )
            atheris.Fuzz()

        made: dict[str, Any] = fuzzing.in_children(name, folder, cases, part)
        return made

    fuzzing.run_targets(__doc__ or "", fuzz, fuzzing.targets, broken=fuzzing.keep)


if __name__ == "__main__":
    main()
