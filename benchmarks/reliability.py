"""Write docs/reliability.md: what was done to break relnav, how often, and what came of it, with dates and commands.

python benchmarks/reliability.py [--cases 1000] [--runs 200] [--sample 100]      (hours)
python benchmarks/reliability.py --add fuzzing.json interruption.json mutation.json    (of runs made before)
python benchmarks/reliability.py --sum fuzzing.json    (of more files, by another seed or other means)

What each target, command or package gave when it was last tried stands in docs/reliability.json, from which the page is
written; a file that is added, written by one of the scripts with --json, replaces what stands there of the same name,
and one that is summed counts on top of it.
"""

import argparse
import json
import platform
import subprocess
import sys
import tempfile
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mutation import judged

ROOT = Path(__file__).resolve().parents[1]
RUNS = ROOT / "docs" / "reliability.json"
NAMED_BY = {
    "fuzzing": "target",
    "fuzzing_calls": "call",
    "interruption": "command",
    "mutation": "room",
    "python_versions": "python",
}
"""Script, and the key that names an entry of what it writes."""


def made(script: str, option: list[str], folder: Path) -> Path:
    """Run a script; where its figures are."""
    out = folder / f"{script}.json"
    subprocess.run([sys.executable, f"benchmarks/{script}.py", *option, "--json", str(out)], cwd=ROOT, check=False)
    return out


def kind_of(entry: dict[str, Any]) -> str:
    """Which script wrote an entry."""
    return next(script for script, key in NAMED_BY.items() if key in entry)


def added(runs: dict[str, list[dict[str, Any]]], entries: list[dict[str, Any]], day: str) -> None:
    """Put new entries in the place of older ones of the same name."""
    for entry in entries:
        script = kind_of(entry)
        if script == "mutation":
            judge(entry)
        key, kept = NAMED_BY[script], runs.setdefault(script, [])
        new = entry | {"date": day, "on": f"Python {platform.python_version()}, {sys.platform}"}
        places = [k for k, old in enumerate(kept) if old[key] == entry[key]]
        if places:
            kept[places[0]] = new
        else:
            kept.append(new)


def judge(entry: dict[str, Any]) -> None:
    """Say of a room's survivors, in place, why they change no answer, where that was found since it was tried."""
    known = judged()
    for one in entry["survivors"]:
        one["why"] = known.get((one["path"], one["within"], one["after"]), "")
    entry["judged"] = sum(bool(one["why"]) for one in entry["survivors"])


def summed(runs: dict[str, list[dict[str, Any]]], entries: list[dict[str, Any]], day: str) -> None:
    """Count new files on top of those that were tried before."""
    for entry in entries:
        old = next((one for one in runs["fuzzing"] if one["target"] == entry["target"]), {})
        outcomes = Counter(old.get("outcomes", {})) + Counter(entry["outcomes"])
        both = {
            "cases": old.get("cases", 0) + entry["cases"],
            "outcomes": dict(sorted(outcomes.items())),
            "faults": sorted({*old.get("faults", []), *entry["faults"]}),
            "memory_mib": max(old.get("memory_mib", 0), entry["memory_mib"]),
        }
        added(runs, [entry | both], day)


def row(*cells: Any) -> str:
    """A line of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def page(runs: dict[str, list[dict[str, Any]]]) -> str:
    """The page, in Markdown."""
    fuzzed, called, ended = runs["fuzzing"], runs["fuzzing_calls"], runs["interruption"]
    faults = [fault for entry in (*fuzzed, *called, *ended) for fault in entry["faults"]]
    lines = [
        "# Reliability",
        "",
        f"Written by `python benchmarks/reliability.py` from `docs/reliability.json`. {total(fuzzed, 'cases')} hostile "
        f"files and {total(called, 'cases')} hostile calls, {total(ended, 'runs')} interrupted runs, "
        f"{total(runs['mutation'], 'tried')} mutants; **{len(faults)} faults** that these found are open. "
        "Each table states what was tried, how often and when. By default the command tries "
        "more: 1,000 cases per target, 200 runs per command, 100 mutants per package. A target in which a "
        "fault was found was run again after the fault was corrected, the others were not.",
        "",
        FUZZED,
    ]
    for entry in fuzzed:
        read, wrong = entry["outcomes"].get("read", 0), len(entry["faults"])
        lines.append(
            row(entry["target"], entry["cases"], read, entry["cases"] - read, wrong, entry["memory_mib"], entry["date"])
        )
    lines += ["", CALLED]
    for entry in called:
        given, refused = (entry["outcomes"].get(name, 0) for name in ("given", "refused"))
        cases, wrong = entry["cases"], len(entry["faults"])
        lines.append(row(entry["call"], cases, given, refused, cases - given - refused, wrong, entry["date"]))
    lines += ["", ENDED]
    for entry in ended:
        codes = ", ".join(f"{name}: {count}" for name, count in entry["codes"].items())
        counts = entry["runs"], entry["finished"], entry["hidden_after_sigkill"]
        lines.append(row(entry["command"], *counts, codes, len(entry["faults"]), entry["date"]))
    lines += ["", MUTATED]
    for entry in runs["mutation"]:
        left = entry["tried"] - entry["killed"] - entry["judged"]
        counts = (entry[name] for name in ("possible", "tried", "killed", "judged"))
        share = f"{entry['killed'] / max(1, entry['tried'] - entry['judged']):.0%}"
        lines.append(row(entry["room"], *counts, left, share, entry["date"]))
    survivors = [one for entry in runs["mutation"] for one in entry["survivors"]]
    lines += ["", *(survivor(one) for one in survivors)]
    tried = [row(entry["python"], entry["outcome"], entry["date"]) for entry in runs["python_versions"]]
    lines += ["", PYTHONS, *(tried or [row("3.11 to 3.14", "not run to its end yet", "")])]
    if faults:
        lines += ["", "## Faults", "", *(f"- {fault}" for fault in faults)]
    return "\n".join([*lines, "", VULNERABLE, LIMITS])


def total(entries: list[dict[str, Any]], key: str) -> int:
    """Of all entries together."""
    return sum(entry[key] for entry in entries)


def survivor(one: dict[str, Any]) -> str:
    """A line on a mutant that no test killed."""
    why = one["why"] or "not judged yet: a test is missing, or it changes nothing"
    return f"- `{one['path']}:{one['line']}`: `{one['before']}` as `{one['after']}`: {why}"


FUZZED = """## Hostile files

`python benchmarks/fuzzing.py --cases N` reads valid files in which names, cells, lines, keys, types, numbers and bytes
were exchanged by hypothesis (`fuzzing_bytes.py` exchanges the bytes). `--inputs 1000000` tries a million files over all
targets, generated from seeds, in child processes. The table is the sum of several runs of both kinds (`reliability.py
--sum`). `fuzzing_coverage.py` is guided by coverage, if `atheris` is installed; none of its files are counted here. The
test suite runs a part of them, and every file that once caused a fault (`tests/files/found/`,
`tests/files/test_fuzzing.py`). A fault is any of these:

- an exception that is not documented, or a warning;
- a message with control characters or without the file's name;
- 5 s of processor time for one file, a minute of waiting, or 1 GiB of memory;
- a number of a track that is not finite, or a covariance that is not positive definite.

| target | files | read | rejected with a message | faults | memory so far, MiB | tried on |
| --- | ---: | ---: | ---: | ---: | ---: | --- |"""
CALLED = """## Hostile calls

`python benchmarks/fuzzing_calls.py --cases N` makes every public call with exchanged numbers, shapes, types, times and
masks, in sequences if the object has a state. The test suite runs some of them, and requires that every public name is
called, or listed with the reason why not (`tests/navigation/test_fuzzed_calls.py`). A fault is any of these:

- an error that is not a ValueError with a printable message, or a warning;
- 5 s of processor time;
- an argument that was changed, an object that a rejected call changed, or a record that changed later;
- a value that is not finite, or a covariance that is not positive definite.

| call | made | value returned | rejected with a message | no value, with its status | faults | tried on |
| --- | ---: | ---: | ---: | ---: | ---: | --- |"""
ENDED = """## Interrupted runs

`python benchmarks/interruption.py --runs N`. Each command is sent SIGINT, SIGTERM and SIGKILL in turn at times drawn
evenly over its run (plain Python). Codes: 130 and 143 are relnav's own; -2, -15 and 1 mean that Python itself was still
starting. A fault is any of these:

- an output that is neither the old file nor the new one byte by byte;
- for `campaign`, which can be resumed: a file that differs from that of an uninterrupted run, or a folder
  that differs, byte by byte, after the same command has been run again;
- new and old outputs of one command together after SIGINT or SIGTERM;
- hidden files that remain, except for one folder after SIGKILL, which the next run has to remove.

| command | runs | had finished | folder left by SIGKILL | exit codes | faults | tried on |
| --- | ---: | ---: | ---: | --- | ---: | --- |"""
MUTATED = """## Mutants of the formulas

`python benchmarks/mutation.py --sample N`: one operator, comparison, number or function of a formula is exchanged, and
the tests that name its module have to fail, in plain Python and within some ten seconds of processor time. They have to
pass unchanged first. A random sample of the mutants of a package or a module is tried. Survivors that change no result
are judged in `benchmarks/mutation_judged.toml`, with the reason; shares are those of the others. For a survivor that
changes a result a test is written, which a later sample shows.

| package or module | possible | tried | killed | judged harmless | survive | killed of the others | tried on |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |"""
PYTHONS = """## Python versions

`python benchmarks/python_versions.py` installs into a fresh environment of each version, makes a call in plain Python
and a compiled one, and runs a quick part of the tests. The wheel has no compiled code here (`RELNAV_PREBUILD=0`).
3.12.1 and 3.13.0 were those of pyenv, 3.14.8 that of Debian testing.

| Python | result | tried on |
| --- | --- | --- |"""
VULNERABLE = """`pip-audit` in the checks searches the dependencies for known vulnerabilities
(`tests/architecture/test_known_vulnerabilities.py`). If the index has no record of them the test is skipped, with that
reason.
"""
LIMITS = """## Limits

| quantity | largest value accepted | reason |
| --- | --- | --- |
| a line | 1,000,000 characters | a row of cells is shorter; endless input ends here |
| columns of a table | 2,000 | |
| lines before the header; empty lines in a row | 10,000; 100,000 | |
| rows of a grid, sun table, star log or orbit | 1,000,000 | held in memory; logs of spots and markers are streamed |
| spots of a star frame; slots of a raw log | 20,000; 5,000,000 | held in memory |
| a row group of Parquet | 100 MB unpacked, and 200 times the file's size | no measured log is so repetitive |
| a model or calibration | 200,000 characters, 12 levels | |
| times, accelerations, impulses of a log | 1e11 s, 1e4 m/s^2, 1e5 m/s | a slip of unit, as nanoseconds under t_s |

A log is read from a file, a named pipe, `<(...)`, `/dev/stdin` or `-`; a pipe is read once, as data arrive. Outputs may
be pipes or `-`: they receive the whole file at the end. If a file is written to standard output, the messages of
`relnav` go to standard error. A killed run leaves at most one folder `.NAME.relnav-part` beside its output.

Not covered are commands that are in no table, an output on a file system without renaming, and files that others change
while they are read. Nor are signals that arrive before Python has started; nothing is written by then.
"""


def main() -> None:
    """Run what is to be run, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--sample", type=int, default=100)
    parser.add_argument("--add", type=Path, nargs="*")
    parser.add_argument("--sum", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reliability.md")
    options = parser.parse_args()
    runs = json.loads(RUNS.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as name:
        told = {
            "fuzzing": ["--cases", str(options.cases)],
            "fuzzing_calls": ["--cases", str(options.cases)],
            "interruption": ["--runs", str(options.runs)],
            "mutation": ["--sample", str(options.sample)],
            "python_versions": [],
        }
        files, day = options.add, datetime.now(UTC).date().isoformat()
        if files is None:
            files = [] if options.sum else [made(script, option, Path(name)) for script, option in told.items()]
        for file in files:
            added(runs, json.loads(file.read_text(encoding="utf-8")), day)
        for file in options.sum:
            summed(runs, json.loads(file.read_text(encoding="utf-8")), day)
    RUNS.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")
    options.out.write_text(page(runs), encoding="utf-8")


if __name__ == "__main__":
    main()
