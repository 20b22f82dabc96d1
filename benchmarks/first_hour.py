"""A new user's first hour with a clock: the `sh` blocks of docs/start.md, word for word, in a fresh checkout.

The files of this checkout are copied into an empty folder, and one shell runs block after block there with nothing
installed but Python. Prints the seconds of each block and the processor time of all; --write puts the table into the
page.

    python benchmarks/first_hour.py [--write] [--keep FOLDER]
"""

import argparse
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "start.md"
MARKS = ("<!-- first hour -->\n", "<!-- end -->")
PLOT, VEHICLE = "track.png", "vehicle_track.csv"


def blocks(page: str) -> list[tuple[str, str]]:
    """(heading, commands) of every `sh` block."""
    found = []
    for part in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        found += [(part.partition("\n")[0], code) for code in re.findall(r"^```sh\n(.*?)^```", part, re.M | re.S)]
    return found


def checkout(folder: Path) -> None:
    """Copy what git knows of this checkout into folder."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def timed(folder: Path, steps: list[tuple[str, str]]) -> list[tuple[str, float]]:
    """Run the blocks in one shell; heading and seconds by the clock of each."""
    stamp = 'echo "$EPOCHREALTIME" >> "$CLOCK"\n'
    script = "set -e\n" + stamp + "".join(f"{code}{stamp}" for _, code in steps)
    kept = ("PATH", "HOME", "LANG", "TMPDIR", "PIP_INDEX_URL", "PIP_CACHE_DIR", "SSL_CERT_FILE")
    plain = {key: os.environ[key] for key in kept if key in os.environ}
    for key in [key for key in os.environ if key.lower().endswith("_proxy")]:
        plain[key] = os.environ[key]
    with tempfile.TemporaryDirectory() as caches:
        clock = Path(caches) / "clock"
        plain |= {"CLOCK": str(clock), "NUMBA_CACHE_DIR": caches, "MPLCONFIGDIR": caches}
        done = subprocess.run(["bash", "-c", script], cwd=folder, env=plain, check=False)
        marks = [float(line) for line in clock.read_text().splitlines()]
    if done.returncode != 0:
        sys.exit(f"block {len(marks)} failed: exit code {done.returncode}")
    return [(name, marks[k + 1] - marks[k]) for k, (name, _) in enumerate(steps)]


def table(rows: list[tuple[str, float]], load: float, cpu_s: float) -> str:
    """The page's table."""
    until = [sum(clock for _, clock in rows[: k + 1]) for k in range(len(rows))]
    lines = [
        "Printed by `python benchmarks/first_hour.py`, which runs these blocks word for word in a fresh checkout and",
        f"an empty environment: Python {platform.python_version()}, {os.cpu_count()} processors, load {load:.1f}",
        "at the start (mean of a minute).",
        "",
        "| block | duration, s | since the start, s |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {clock:.0f} | {at:.0f} |" for (name, clock), at in zip(rows, until, strict=True)),
        "",
        f"Total processor time: {cpu_s:.0f} s. Reading and editing are not included.",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run, and say how long it took."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="put the table into docs/start.md")
    parser.add_argument("--keep", type=Path, help="an empty folder to work in, which stays")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        checkout(folder)
        rows = timed(folder, blocks(PAGE.read_text("utf-8")))
        missing = [name for name in (PLOT, VEHICLE) if not (folder / name).is_file()]
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    said = table(rows, load, used.ru_utime + used.ru_stime)
    print(said)
    if missing:
        sys.exit(f"not written: {', '.join(missing)}")
    if options.write:
        before, _, rest = PAGE.read_text("utf-8").partition(MARKS[0])
        PAGE.write_text(before + MARKS[0] + said + MARKS[1] + rest.partition(MARKS[1])[2], "utf-8")


if __name__ == "__main__":
    main()
