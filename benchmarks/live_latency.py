"""How long an estimate takes under `relnav filter --follow`: from the row's end to the line that can be read.

Rows are written one by one at a rate, to a pipe or to a file that grows, and each line is awaited. The time runs from
just before the row's line feed is written to just after its estimate was read, in another process: both systems' calls
and both wake-ups are in it.

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


def rows_of(model: str, rows: int, folder: Path) -> list[str]:
    """Header and rows of a log."""
    if model == "three_beacon_psd":
        text = FLOWN.read_text()
    else:
        path = folder / "log.csv"
        command = [
            sys.executable,
            "-m",
            "relnav",
            "simulate",
            model,
            "--duration",
            str(rows / 10.0),
            "--out",
            str(path),
        ]
        subprocess.run(command, check=True, capture_output=True)
        text = path.read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return lines[: rows + 1]


def processor_s(process: int) -> float:
    """Processor time that a process has used."""
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def measure(model: str, lines: list[str], way: str, row_format: str, rate_hz: float, folder: Path) -> None:
    """Feed the rows one way, print the times."""
    grown = folder / f"grown_{model}_{way}_{row_format}.csv"
    grown.touch()
    command = [
        sys.executable,
        "-m",
        "relnav",
        "filter",
        "--follow",
        "--model",
        model,
        "--format",
        row_format,
        "--quiet",
    ]
    command.append("-" if way == "pipe" else str(grown))
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stdout is not None
    into = process.stdin.fileno() if way == "pipe" else os.open(grown, os.O_WRONLY | os.O_APPEND)
    os.write(into, f"{lines[0]}\n".encode())
    taken, begin, before = [], 0.0, 0.0
    for row, line in enumerate(lines[1:]):
        os.write(into, line.encode())
        start = time.perf_counter()
        os.write(into, b"\n")
        answer = process.stdout.readline()
        while answer.startswith((b"#", b"t_s")):
            answer = process.stdout.readline()
        taken.append(time.perf_counter() - start)
        if row == FIRST:
            begin, before = time.perf_counter(), processor_s(process.pid)
        time.sleep(max(0.0, 1.0 / rate_hz - taken[-1]))
    lasted, used = time.perf_counter() - begin, processor_s(process.pid) - before
    if way == "pipe":
        process.stdin.close()
    else:
        process.terminate()
    process.wait()
    ms = 1e3 * np.array(taken[FIRST:])
    print(
        f"{model:20} {way:5} {row_format:6} {len(ms):5} rows  median {np.median(ms):.2f} ms  99 % "
        f"{np.quantile(ms, 0.99):.2f} ms  longest {ms.max():.2f} ms  first {1e3 * max(taken[:FIRST]):.0f} ms  "
        f"processor {1e3 * used / len(ms):.2f} ms a row, {100.0 * used / lasted:.0f} %"
    )


def main() -> None:
    """Measure all ways."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1000)
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument("--model", action="append", help="default: three_beacon_psd and three_marker_vision")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for model in arguments.model or ["three_beacon_psd", "three_marker_vision"]:
            lines = rows_of(model, arguments.rows, Path(folder))
            for way in ("pipe", "file"):
                for row_format in ("csv", "jsonl"):
                    measure(model, lines, way, row_format, arguments.rate_hz, Path(folder))


if __name__ == "__main__":
    main()
