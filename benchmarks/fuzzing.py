"""Files made to break the readers and the filters: mutated where their structure is, not only bit by bit.

A case is a good file with some of its parts exchanged: names, cells, lines and bytes of a table; keys, values and lines
of a model; columns, types and bytes of Parquet; chunks of a picture; files of a folder; numbers of a log that is then
filtered. `fuzzing_readers.py` beside this names what reads them. What must hold: an error is one of the documented
kinds and one printable message that names the file; none takes 5 s of processor time, or waits for a minute; every
number of a track is finite where it has a state, and every covariance positive definite; memory stays below 1 GiB.

    python benchmarks/fuzzing.py [--cases 1000] [--target models] [--json FILE]
    python benchmarks/fuzzing.py --inputs 1000000 --json FILE       (over all targets, in rounds of other seeds)

A file that breaks something is made small and put into tests/files/found/, where the test suite tries it from then on,
with a few hundred of these cases (tests/files/test_fuzzing.py).
"""

import argparse
import json
import mmap
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from fuzzing_choices import Choices, Drawn, Seeded
from fuzzing_readers import Maker, targets
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from relnav.errors import InputError, UsageError

SLOWEST_S, LONGEST_S, MOST_MIB = 5.0, 60.0, 1024
FOUND = Path(__file__).resolve().parents[1] / "tests" / "files" / "found"
ROUND, MOST_FAULTS = 2000, 10
"""Cases of a target in one round (hypothesis remembers what it has tried, so that more make it slow), and the kinds of
faults after which a target is left alone."""
SHARE = {"beacon track": 0.02, "marker track": 0.01, "vehicle track": 0.01, "campaign, its summary": 0.05}
SHARE |= {"campaign, its description": 0.05, "campaign, its runs": 0.05}
"""Part of a round that a target is given whose cases take long."""


class HungError(BaseException):
    """A case did not come to its end; no Exception, which what is tried may catch."""


def _hung(number: int, frame: object) -> None:  # noqa: ARG001  (the signature of a signal's handler)
    raise HungError


@contextmanager
def watched(processor_s: float = SLOWEST_S) -> Iterator[None]:
    """AssertionError instead of what takes so much processor time, or waits for a minute."""
    timers = {signal.ITIMER_PROF: processor_s, signal.ITIMER_REAL: max(LONGEST_S, 12.0 * processor_s)}
    before = {number: signal.signal(number, _hung) for number in (signal.SIGPROF, signal.SIGALRM)}
    for timer, seconds in timers.items():
        signal.setitimer(timer, seconds)
    try:
        yield
    except HungError:
        raise AssertionError("it takes too long") from None
    finally:
        for timer in timers:
            signal.setitimer(timer, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def try_one(path: Path, read: Callable[[Path], Any], content: bytes, named: Path | None = None) -> str:
    """Read one file; "read" or the kind of its error. AssertionError for everything that must not be.

    `named` is what a message has to name, if not the file: the folder that is read.
    """
    path.write_bytes(content)
    for limit in (24.0 * SLOWEST_S, SLOWEST_S):  # again if it was slow: the first call of all compiles
        begin = time.process_time()
        try:
            with warnings.catch_warnings(), watched(limit):
                warnings.simplefilter("error")
                read(path)
            outcome, message = "read", str(path)
        except (InputError, UsageError) as error:
            outcome, message = type(error).__name__, str(error)
        took = time.process_time() - begin
        if took < SLOWEST_S:
            break
    assert took < SLOWEST_S, "it takes too long"
    assert str(named or path) in message, f"a message does not name its file: {message}"
    assert len(message) < 30_000
    for line in message.split("\n"):
        assert line.isprintable(), f"a message holds what a terminal obeys: {line!r}"
    return outcome


def try_cases(
    strategy: Any, one: Callable[[Any], None], cases: int, *, derandomize: bool = False, number: int | None = None
) -> None:
    """So many cases of a strategy, of a seed if one is given; the first that must not be is raised, made small."""

    @settings(
        max_examples=cases,
        deadline=None,
        database=None,
        derandomize=derandomize,
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )
    @given(strategy)
    def each(case: Any) -> None:
        one(case)

    (each if number is None else seed(number)(each))()


def fuzz(
    name: str, folder: Path, cases: int, *, derandomize: bool = False, number: int | None = None
) -> dict[str, Any]:
    """Try so many cases of one target; what came of them.

    Hypothesis draws them, and raises the first that must not be, made small. Those of a seed (`number`) are made a
    hundred times quicker; the first file of each kind of fault is kept as it is.
    """
    if number is not None:
        return seeded(name, folder, cases, number)
    one, make, outcomes = tried(name, folder)
    try_cases(st.composite(lambda draw: make(Drawn(draw)))(), one, cases, derandomize=derandomize)
    return told(name, outcomes, [])


def tried(name: str, folder: Path) -> tuple[Callable[[bytes], None], Maker, Counter[str]]:
    """What tries one content of a target, what makes contents, and what came of those that were tried."""
    ending, read, make = targets(folder)[name]
    path, named = folder / ending, folder / Path(ending).parts[0]
    outcomes: Counter[str] = Counter()

    def one(content: bytes) -> None:
        outcomes[try_one(path, read, content, named)] += 1

    return one, make, outcomes


def told(name: str, outcomes: Counter[str], faults: list[str]) -> dict[str, Any]:
    """An entry of what the script writes."""
    return {"target": name, "cases": outcomes.total(), "outcomes": dict(sorted(outcomes.items())), "faults": faults}


class Trial:
    """Cases of one target in a child; `at` is the number of the one that is tried."""

    def __init__(self, name: str, folder: Path, at: mmap.mmap) -> None:
        self.name, self.folder, self.at = name, folder, at
        self.one, self.make, self.outcomes = tried(name, folder)
        self.faults: list[str] = []

    def take(self, case: int, choose: Choices) -> None:
        """Try one; the first file of a kind of fault is kept."""
        self.at[:] = case.to_bytes(8, "little")
        try:
            self.one(self.make(choose))
        except Exception as error:
            self.outcomes["fault"] += 1
            if (fault := kind_of_fault(error)) not in self.faults:
                self.faults.append(fault)
                keep(self.name, self.folder)

    def entry(self, cases: int) -> dict[str, Any]:
        """What came of all of them."""
        self.at[:] = cases.to_bytes(8, "little")
        used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        return told(self.name, self.outcomes, self.faults) | {"memory_mib": used}


Answer = Callable[[dict[str, Any]], None]


def seeded(name: str, folder: Path, cases: int, number: int) -> dict[str, Any]:
    """Cases of a seed."""

    def part(trial: Trial, begin: int, answer: Answer) -> None:
        for case in range(begin, cases):
            trial.take(case, Seeded(random.Random(f"{number} {case}")))
        answer(trial.entry(cases))

    return in_children(name, folder, cases, part)


def in_children(name: str, folder: Path, cases: int, part: Callable[[Trial, int, Answer], None]) -> dict[str, Any]:
    """Cases in a child, since a library in another language can end the process; in another one after that."""
    outcomes: Counter[str] = Counter()
    faults: list[str] = []
    memory, at = 0, mmap.mmap(-1, 8)
    while (begin := int.from_bytes(at, "little")) < cases:
        read, write = os.pipe()
        if (child := os.fork()) == 0:
            try:
                part(Trial(name, folder, at), begin, partial(_answer, write))
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        os.close(write)
        with os.fdopen(read, "rb") as pipe:
            content = pipe.read()
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if content:
            new = json.loads(content)
            outcomes += Counter(new["outcomes"])
            faults += [fault for fault in new["faults"] if fault not in faults]
            memory = max(memory, new["memory_mib"])
            continue
        stopped = int.from_bytes(at, "little")
        outcomes += Counter({"not counted": stopped - begin, "fault": 1})
        if (fault := f"the process ended with {code}") not in faults:
            faults.append(fault)
            keep(name, folder)
        at[:] = (stopped + 1).to_bytes(8, "little")
    return told(name, outcomes, faults) | {"memory_mib": memory}


def _answer(write: int, entry: dict[str, Any]) -> None:
    """What a child says at its end."""
    os.write(write, json.dumps(entry).encode())
    os._exit(0)


def kind_of_fault(error: Exception) -> str:
    """What went wrong and where, without the values that differ from file to file."""
    places = [place for place in traceback.extract_tb(error.__traceback__) if "relnav" in place.filename]
    where = f"{Path(places[-1].filename).name}:{places[-1].lineno}: " if places else ""
    return f"{where}{type(error).__name__}: {re.sub('[0-9]+', '0', str(error))[:200]}"


def keep(name: str, folder: Path) -> None:
    """Put the file on which a target broke among those that the test suite tries."""
    path = folder / targets(folder)[name][0]
    if path.is_file():
        FOUND.mkdir(exist_ok=True)
        shutil.copy(path, FOUND / f"{name.replace(' ', '_')}-{len(list(FOUND.iterdir()))}{path.suffix}")


def _round(options: argparse.Namespace, target: str, number: int) -> int:
    """Cases of a target in a round."""
    if options.inputs is None:
        return int(options.cases)
    return max(10, int(ROUND * SHARE.get(target, 1.0))) if number else min(10, options.inputs)


def run_targets(
    about: str,
    fuzz_one: Callable[..., dict[str, Any]],
    names: Callable[[Path], Iterable[str]],
    word: str = "target",
    broken: Callable[[str, Path], None] | None = None,
) -> None:
    """The command line of a script that fuzzes: its targets one after another, what came of each, in JSON too."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("--cases", type=int, default=1000, help="Of each target.")
    parser.add_argument("--inputs", type=int, help="Of all targets together, in rounds, instead of --cases.")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="Of processor time; then begin no more.")
    parser.add_argument("--seed", type=int, default=0, help="Of the first round; the next ones count on.")
    parser.add_argument("--target", action="append")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found: dict[str, dict[str, Any]] = {}
    number = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        every = list(options.target or names(folder))

        def goes_on() -> bool:
            count = sum(entry["cases"] for entry in found.values())
            whole = all(target in found for target in every) and (options.inputs is None or count >= options.inputs)
            return not whole and time.process_time() < options.seconds

        while goes_on():
            for target in every:
                if not goes_on():
                    break
                if target in found and len(found[target]["faults"]) >= MOST_FAULTS:
                    continue
                entry = found.setdefault(target, {word: target, "cases": 0, "outcomes": {}, "faults": []})
                seeds = {} if options.inputs is None else {"number": options.seed + number}
                try:
                    new = fuzz_one(target, folder, _round(options, target, number), **seeds)
                    entry["cases"] += new["cases"]
                    entry["outcomes"] = dict(sorted((Counter(entry["outcomes"]) + Counter(new["outcomes"])).items()))
                    entry["memory_mib"] = max(entry.get("memory_mib", 0), new.get("memory_mib", 0))
                    entry["faults"] += [fault for fault in new["faults"] if fault not in entry["faults"]]
                except Exception as error:
                    notes = getattr(error, "__notes__", [])
                    entry["faults"].append("; ".join([f"{type(error).__name__}: {error}", *notes]))
                    if broken is not None:
                        broken(target, folder)
                used = max(entry.get("memory_mib", 0), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
                entry["memory_mib"] = used
                if used > MOST_MIB and "more than 1 GiB of memory" not in entry["faults"]:
                    entry["faults"].append("more than 1 GiB of memory")
                print(json.dumps(entry), flush=True)
            if all(len(found.get(target, {}).get("faults", ())) >= MOST_FAULTS for target in every):
                break
            number += 1
            if options.json:
                options.json.write_text(json.dumps(list(found.values()), indent=2) + "\n")
    if options.json:
        options.json.write_text(json.dumps(list(found.values()), indent=2) + "\n")
    sys.exit(any(entry["faults"] for entry in found.values()))


if __name__ == "__main__":
    run_targets(__doc__ or "", fuzz, targets, broken=keep)
