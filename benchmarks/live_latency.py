"""How long an estimate takes under `relnav filter --follow`: from the row's end to the line that can be read.

Rows are written one by one at a rate, to a pipe or to a file that grows, and each line is awaited. The time runs from
just before the row's line feed is written to just after its estimate was read, in another process: both systems' calls
and both wake-ups are in it. Of a vehicle the rows that bring a line are timed, the first of each second of its log;
its rows, five times as many, are written at five times the rate.

    python benchmarks/live_latency.py
    python benchmarks/live_latency.py --rows 3000 --rate-hz 50 --model three_marker_vision

Prints median, 99 % and longest, the first five rows apart (code is loaded then), and relnav's share of one processor.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

FLOWN = Path(__file__).parents[1] / "examples" / "basilisk_approach" / "vbar_log.csv"
FIRST = 5
VEHICLE = "rendezvous_demo"
VEHICLE_ROWS = 5
"""Times as many rows of a vehicle, and so many times as fast."""


def rows_of(model: str, rows: int, folder: Path) -> list[str]:
    """Header and rows of a log."""
    if model == "three_beacon_psd":
        text = FLOWN.read_text()
    else:
        path = folder / "log.csv"
        length = ("--final-range", "24") if model == VEHICLE else ("--duration", str(rows / 10.0))
        command = [sys.executable, "-m", "relnav", "simulate", model, *length, "--out", str(path)]
        subprocess.run(command, check=True, capture_output=True)
        text = path.read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return lines[: rows + 1]


def awaited(lines: list[str], model: str) -> list[bool]:
    """Which rows bring a line: all but of a vehicle, whose lines are those of whole seconds that a row has reached."""
    if model != VEHICLE:
        return [True] * len(lines)
    second = np.floor([float(line.partition(",")[0]) for line in lines])
    newest = np.maximum.accumulate(second)  # what came late brings no line
    return [bool(new) for new in np.diff(newest, prepend=0.0) > 0.0]


def processor_s(process: int) -> float:
    """Processor time that a process has used."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measure(model: str, lines: list[str], way: str, row_format: str, rate_hz: float, folder: Path) -> None:
    """Feed the rows one way, print the times."""
    grown = folder / f"grown_{model}_{way}_{row_format}.csv"
    grown.touch()
    options = ("--model", model, "--format", row_format, "--quiet")
    command = [sys.executable, "-m", "relnav", "filter", "--follow", *options]
    command.append("-" if way == "pipe" else str(grown))
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stdout is not None
    into = process.stdin.fileno() if way == "pipe" else os.open(grown, os.O_WRONLY | os.O_APPEND)
    os.write(into, f"{lines[0]}\n".encode())
    taken, begin, before = [], 0.0, 0.0
    for row, (line, answered) in enumerate(zip(lines[1:], awaited(lines[1:], model), strict=True)):
        os.write(into, line.encode())
        start = time.perf_counter()
        os.write(into, b"\n")
        answer = process.stdout.readline() if answered else b""
        while answer.startswith((b"#", b"t_s")):
            answer = process.stdout.readline()
        passed = time.perf_counter() - start
        if answered:
            taken.append(passed)
        if row == FIRST:
            begin, before = time.perf_counter(), processor_s(process.pid)
        time.sleep(max(0.0, 1.0 / rate_hz - passed))
    lasted, used = time.perf_counter() - begin, processor_s(process.pid) - before
    if way == "pipe":
        process.stdin.close()
    else:
        process.terminate()
    process.wait()
    ms = 1e3 * np.array(taken[FIRST:])
    print(
        f"{model:20} {way:5} {row_format:6} {len(ms):5} lines  median {np.median(ms):.2f} ms  99 % "
        f"{np.quantile(ms, 0.99):.2f} ms  longest {ms.max():.2f} ms  first {1e3 * max(taken[:FIRST]):.0f} ms  "
        f"processor {1e3 * used / (len(lines) - 2 - FIRST):.2f} ms a row, {100.0 * used / lasted:.0f} %"
    )


def main() -> None:
    """Measure all ways."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1000)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument("--model", action="append", help="default: beacons, markers and a vehicle")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(f"load of this machine before: {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
        for model in arguments.model or ["three_beacon_psd", "three_marker_vision", VEHICLE]:
            times = VEHICLE_ROWS if model == VEHICLE else 1
            lines = rows_of(model, arguments.rows * times, Path(folder))
            for way in ("pipe", "file"):
                for row_format in ("csv", "jsonl"):
                    measure(model, lines, way, row_format, arguments.rate_hz * times, Path(folder))


if __name__ == "__main__":
    main()
