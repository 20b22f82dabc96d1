"""Campaigns whose worker, scheduler or driver is killed at a random time: the same bytes as of one never disturbed.

    python benchmarks/campaign_kills.py [--kills 20] [--workers 0 1 2 4] [--json FILE]

First one campaign for each number of workers (0: threads of the driver), then so many for each victim: a scheduler and
two workers run as programs of their own, the driver is `relnav campaign`, and the victim gets SIGKILL at a time drawn
evenly over the time that an undisturbed campaign takes from its folder on. What died is started again, the command too
if it ended with an error. Then every file of the folder is compared with that of one thread, and no other may be left.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

VICTIMS = ("worker", "scheduler", "driver")
CAMPAIGN = ("three_beacon_psd", "--seed", "3", "--set", "approach.duration_s=200", "--set",
            "spread.start_sigma_m=[0.3, 0.1, 0.1]", "--no-pictures", "--quiet")  # fmt: skip
LONGEST_S = 600.0
"""For a command to end; one that takes longer hangs."""


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


class Cluster:
    """A scheduler and workers, each a program of its own."""

    def __init__(self, place: Path, workers: int) -> None:
        self.file, self._log = place / "scheduler.json", (place / "cluster.log").open("ab")
        self._count = workers
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: list[subprocess.Popen[bytes]] = []
        self.revive()

    def _start(self, name: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{name}", "--scheduler-file", str(self.file), *words]
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        return subprocess.Popen(command, stdout=self._log, stderr=self._log, cwd=self.file.parent, env=environment)

    def revive(self) -> None:
        """Start what is not running; a new scheduler gets new workers."""
        if self.scheduler is None or self.scheduler.poll() is not None:
            self._end(self.workers)
            self.workers = []
            self.file.unlink(missing_ok=True)
            self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
            while not self.file.is_file():
                time.sleep(0.1)
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) < self._count:
            self.workers.append(
                self._start("worker", "--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1")
            )

    @staticmethod
    def _end(processes: list[subprocess.Popen[bytes]]) -> None:
        for process in processes:
            process.kill()
            process.wait()

    def end(self) -> None:
        """Stop all of it."""
        self._end([*self.workers, *([] if self.scheduler is None else [self.scheduler])])
        self._log.close()


def command(runs: int, out: Path, *words: str) -> list[str]:
    """The driver's command line."""
    return [sys.executable, "-m", "relnav", "campaign", *CAMPAIGN, "--runs", str(runs), *words, "--out", str(out)]


def begins(out: Path, driver: subprocess.Popen[bytes]) -> float:
    """Wait until a driver has made its folder; the time."""
    while not (out / "campaign.json").is_file() and driver.poll() is None:
        time.sleep(0.005)
    return time.monotonic()


def attempt(
    cluster: Cluster, victim: str, begun: list[str], at_s: float, rng: np.random.Generator
) -> dict[str, object]:
    """One campaign with one kill; what happened."""
    driver = subprocess.Popen(begun, stderr=subprocess.PIPE)
    began = begins(Path(begun[-1]), driver)
    while time.monotonic() - began < at_s and driver.poll() is None:
        time.sleep(0.005)
    hit = driver.poll() is None
    process = {"driver": driver, "scheduler": cluster.scheduler}.get(victim)
    (process or cluster.workers[int(rng.integers(len(cluster.workers)))]).kill()
    time.sleep(0.2)
    calls, hung, said = 1, False, ""
    while True:
        cluster.revive()
        try:
            _, error = driver.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            hung = True
            driver.kill()
            _, error = driver.communicate()
        said = said or error.decode().strip()[-300:]
        if driver.returncode == 0 or calls == 4:
            break
        calls += 1
        driver = subprocess.Popen(begun, stderr=subprocess.PIPE)
    took = time.monotonic() - began
    row: dict[str, object] = {"victim": victim, "at_s": round(at_s, 2), "hit": hit, "calls": calls, "hung": hung}
    return row | {"took_s": round(took, 1), "code": driver.returncode, "said": said}


def main() -> None:
    """Run it and say what was found; the exit code says whether all bytes are the same."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=20, help="of each of worker, scheduler and driver")
    parser.add_argument("--workers", type=int, nargs="*", default=[0, 1, 2, 4])
    parser.add_argument("--runs", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=0, help="of the times")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rng, rows = np.random.default_rng(options.seed), []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        subprocess.run(command(options.runs, place / "whole", "--workers", "1"), check=True)
        whole = contents(place / "whole")
        for workers in options.workers:
            words = ("--cluster", "local", "--workers", str(workers)) if workers else ("--workers", "2")
            out = place / f"workers-{workers}"
            subprocess.run(command(options.runs, out, *words), check=True)
            rows.append({"workers": workers, "same": contents(out) == whole})
            print(f"{workers} workers: {'the same bytes' if rows[-1]['same'] else 'OTHER BYTES'}", flush=True)
        cluster = Cluster(place, 2)
        try:
            words = ("--cluster", str(cluster.file))
            for out in (place / "first", place / "undisturbed"):
                driver = subprocess.Popen(command(options.runs, out, *words))
                began = begins(out, driver)
                assert driver.wait() == 0, "an undisturbed campaign failed"
                length = time.monotonic() - began
            print(f"undisturbed on two workers: {length:.1f} s", flush=True)
            for victim in VICTIMS * options.kills:
                out = place / f"kill-{len(rows)}"
                row = attempt(cluster, victim, command(options.runs, out, *words), float(rng.uniform(0.0, length)), rng)
                row["same"] = row["code"] == 0 and contents(out) == whole
                rows.append(row)
                print(row, flush=True)
        finally:
            cluster.end()
    for victim in VICTIMS:
        of = [row for row in rows if row.get("victim") == victim]
        same, hit = (sum(bool(row[key]) for row in of) for key in ("same", "hit"))
        calls, hung = sum(int(row["calls"]) for row in of), sum(bool(row["hung"]) for row in of)
        print(f"{victim}: {same} of {len(of)} the same bytes; {hit} killed under way, {calls} calls, {hung} hung")
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")
    sys.exit(0 if all(row["same"] for row in rows) else 1)


if __name__ == "__main__":
    main()
