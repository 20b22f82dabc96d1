"""Write docs/reliability.md: what the files made to break relnav and the interrupted runs came to, with their counts.

python benchmarks/reliability.py [--cases 1000] [--runs 200] [--out docs/reliability.md]
python benchmarks/reliability.py --fuzzed FUZZ.json --interrupted ENDED.json    (of runs made before)
"""

import argparse
import json
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def made(script: str, option: str, number: int, folder: Path) -> Path:
    """Run a script; where its figures are."""
    out = folder / f"{script}.json"
    command = [sys.executable, f"benchmarks/{script}.py", option, str(number), "--json", str(out)]
    subprocess.run(command, cwd=ROOT, check=False)
    return out


def page(fuzzed: list[dict[str, Any]], ended: list[dict[str, Any]], note: str, day: str) -> str:
    """The page, in Markdown."""
    faults = [fault for entry in (*fuzzed, *ended) for fault in entry["faults"]]
    cases, runs = sum(entry["cases"] for entry in fuzzed), sum(entry["runs"] for entry in ended)
    lines = [
        "# Reliability",
        "",
        f"Made by `python benchmarks/reliability.py` on {day}, Python {platform.python_version()}, {sys.platform}. "
        f"{cases} files made to break it, {runs} interrupted runs, **{len(faults)} faults**.",
        *(["", note] if note else []),
        "",
        FUZZED,
    ]
    for entry in fuzzed:
        read = entry["outcomes"].get("read", 0)
        refused, wrong = entry["cases"] - read, len(entry["faults"])
        lines.append(f"| {entry['target']} | {entry['cases']} | {read} | {refused} | {wrong} | {entry['memory_mib']} |")
    lines += ["", ENDED]
    for entry in ended:
        codes = ", ".join(f"{name}: {count}" for name, count in entry["codes"].items())
        lines.append(
            f"| {entry['command']} | {entry['runs']} | {entry['finished']} | {entry['hidden_after_sigkill']} | {codes} "
            f"| {len(entry['faults'])} |"
        )
    if faults:
        lines += ["", "## Faults", "", *(f"- {fault}" for fault in faults)]
    return "\n".join([*lines, "", LIMITS])


FUZZED = """## Files made to break it

`python benchmarks/fuzzing.py --cases N`. Good files with names, cells, lines, keys, types, numbers and bytes exchanged
(hypothesis; the strategies are in the script). A fault is: an exception that is not documented, a warning, a message
with control characters or without the file's name, 5 s of processor time for one file, 1 GiB of memory, a number of a
track that is not finite, a covariance that is not positive definite. The test suite runs a part of them
(`tests/files/test_fuzzing.py`).

| target | files | read | refused in a sentence | faults | memory so far, MiB |
| --- | ---: | ---: | ---: | ---: | ---: |"""
ENDED = """## Interrupted runs

`python benchmarks/interruption.py --runs N`. Each command is sent SIGINT, SIGTERM and SIGKILL in turn at times drawn
evenly over its run (plain Python). A fault is: an output that is neither the old file nor the new one byte by byte; new
and old outputs of one command side by side after SIGINT or SIGTERM; anything hidden that is left behind, but for one
folder after SIGKILL, which the next run has to remove. Codes: 130 and 143 are relnav's own; -2 and -15 mean that Python
itself was still starting.

| command | runs | had finished | folder left by SIGKILL | exit codes | faults |
| --- | ---: | ---: | ---: | --- | ---: |"""
LIMITS = """## Limits

| what | is refused beyond | why |
| --- | --- | --- |
| a line | 1,000,000 characters | a row of cells is shorter; endless input ends here |
| columns of a table | 2,000 | |
| lines before the header; empty lines in a row | 10,000; 100,000 | |
| rows of a grid, sun table, star log or orbit | 1,000,000 | held in memory; logs of spots and markers are streamed |
| spots of a star frame; slots of a raw log | 20,000; 5,000,000 | held in memory |
| a column of Parquet | 100 MB unpacked from less than a 200th | no measured log is so repetitive |
| a model or calibration | 200,000 characters, 12 levels | |
| times, accelerations, impulses of a log | 1e11 s, 1e4 m/s^2, 1e5 m/s | a slip of unit, as nanoseconds under t_s |

A log comes from a file, a named pipe, `<(...)`, `/dev/stdin` or `-`; a pipe is read once, as it comes. Outputs may be
pipes or `-`: they are given the whole file at the end. What `relnav` prints beside a file on standard output goes to
standard error. A killed run leaves at most one folder `.NAME.relnav-part` beside its output.

Not covered: an output on a file system without renaming, files changed by others while they are read, and signals that
arrive before Python has started (nothing is written by then).
"""


def main() -> None:
    """Run what is to be run, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--fuzzed", type=Path)
    parser.add_argument("--interrupted", type=Path)
    parser.add_argument("--note", default="", help="What a reader must know of how these runs were made.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reliability.md")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        fuzzed = options.fuzzed or made("fuzzing", "--cases", options.cases, Path(name))
        ended = options.interrupted or made("interruption", "--runs", options.runs, Path(name))
        figures = [json.loads(path.read_text()) for path in (fuzzed, ended)]
    options.out.write_text(page(*figures, options.note, datetime.now(UTC).date().isoformat()), encoding="utf-8")


if __name__ == "__main__":
    main()
