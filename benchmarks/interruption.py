"""Every command that writes, ended at random times: its files are whole or absent, and nothing is left behind.

Each command is run once to the end; what it wrote is the reference. Then it is started again and again and sent SIGINT,
SIGTERM or SIGKILL at a time drawn evenly over its run. After each of them every output is either as it was before or
the reference, byte by byte; no hidden folder stays, but for SIGKILL at most one, which the next whole run removes.

A campaign goes on where it was stopped: whatever it left in its folder is a file of the reference, and the same
command, run again to the end, makes the folder the reference, byte by byte.

    python benchmarks/interruption.py [--runs 200] [--command filter] [--json FILE]
"""

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
MODEL = ("--model", "three_beacon_psd")
COMMANDS = {
    "filter": (["filter", "log.csv", *MODEL, "--out", "track.csv", "--json", "a.json"], ["track.csv", "a.json"]),
    "smooth": (["filter", "log.csv", *MODEL, "--smooth", "--out", "track.parquet"], ["track.parquet"]),
    "simulate": (
        ["simulate", "three_beacon_psd", "--duration", "20", "--out", "sim.csv", "--truth", "truth.csv"],
        ["sim.csv", "truth.csv"],
    ),
    "calibrate": (["calibrate", "psd", "grid.csv", "--out", "c.toml", "--json", "c.json"], ["c.toml", "c.json"]),
    "models": (["models", "aps_sun", "--copy", "mine.toml", "--json", "m.json"], ["mine.toml", "m.json"]),
    "stars": (["stars", "solve", "frame.csv", "--focal-px", "3000", "--json", "s.json"], ["s.json"]),
    "sun": (
        ["sun", "measure", "sun.csv", "--model", "aps_sun", "--out", "d.csv", "--json", "d.json"],
        ["d.csv", "d.json"],
    ),
    "budget": (["budget", "three_beacon_psd", "--json", "b.json"], ["b.json"]),
    "accuracy": (["accuracy", "birefringent_sun", "--runs", "60", "--json", "acc.json"], ["acc.json"]),
    "report": (["report", "log.csv", *MODEL, "--out", "r.html"], ["r.html"]),
    "markers": (
        ["filter", "markers.csv", "--model", "three_marker_vision", "--out", "m.csv", "--json", "mk.json"],
        ["m.csv", "mk.json"],
    ),
    "vehicle": (
        ["filter", "vehicle.csv", "--model", "rendezvous_demo", "--out", "v.csv", "--json", "v.json"],
        ["v.csv", "v.json"],
    ),
}
FOLDERS = {
    "campaign": (
        ["campaign", "three_beacon_psd", "--runs", "8", "--seed", "3", "--set", "approach.duration_s=2", "--set",
         "spread.start_sigma_m=[0.3, 0.1, 0.1]", "--workers", "1", "--no-pictures", "--out", "camp"],
        "camp",
    ),
}  # fmt: skip
"""Commands that go on where they were stopped, with the folder that they fill."""
SIGNALS = {"SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM, "SIGKILL": signal.SIGKILL}
OLD = "of yesterday\n"


def prepare(folder: Path) -> None:
    """Inputs of all commands."""
    rows = (ROOT / "examples" / "basilisk_approach" / "vbar_log.csv").read_text().splitlines(keepends=True)
    (folder / "log.csv").write_text("".join(rows[:151]))
    rng = np.random.default_rng(0)
    places = [(x, y) for x in range(-3000, 3001, 500) for y in range(-3000, 3001, 500)]
    grid = [
        f"{x},{y},{1.01 * x + dx!r},{1.01 * y + dy!r}"
        for (x, y), (dx, dy) in zip(places, rng.normal(0, 5, (169, 2)).tolist(), strict=True)
    ]
    (folder / "grid.csv").write_text("\n".join(["true_x_um,true_y_um,spot_x_um,spot_y_um", *grid]))
    spots = [f"{x!r},{y!r},{abs(flux)!r}" for x, y, flux in rng.uniform(-500, 500, (5, 3)).tolist()]
    directions = [f"{k},{512 + 3 * k},{512 - k}" for k in range(200)]
    (folder / "sun.csv").write_text("\n".join(["t_s,spot_x_px,spot_y_px", *directions]))
    (folder / "frame.csv").write_text("\n".join(["x_px,y_px,flux", *spots]))
    names = ",".join(f"spot_{beacon}_{axis}_px" for beacon in "abc" for axis in "xy")
    markers = [f"{0.1 * k:.1f},469.3,553.7,553.7,553.7,511.5,511.5" for k in range(40)]
    (folder / "markers.csv").write_text("\n".join([f"t_s,{names}", *markers]))
    samples = [f"{0.01 * k:.2f},gyro,0,0.00113,0" for k in range(200)]
    (folder / "vehicle.csv").write_text("\n".join(["t_s,sensor,v0,v1,v2", *samples]))


def start(arguments: list[str], folder: Path) -> subprocess.Popen[bytes]:
    """A command in plain Python, in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "relnav", *arguments],
        cwd=folder,
        env=os.environ | {"RELNAV_JIT": "0", "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def hidden(folder: Path) -> list[str]:
    """What a command left that is no output."""
    return sorted(entry.name for entry in folder.iterdir() if entry.name.startswith("."))


def undisturbed(arguments: list[str], folder: Path) -> float:
    """How long a command takes that nobody ends, in seconds."""
    begin = time.monotonic()
    process = start(arguments, folder)
    error = process.communicate()[1].decode()
    if error or process.returncode:
        raise RuntimeError(f"{arguments[0]} does not run by itself: exit code {process.returncode}: {error}")
    return time.monotonic() - begin


def end_at_random(name: str, folder: Path, runs: int, seed: int = 0) -> dict[str, object]:
    """Run a command so many times, end it, and count what came; `faults` are sentences, none if all is well."""
    arguments, outputs = COMMANDS[name]
    rng = np.random.default_rng(seed)
    length = undisturbed(arguments, folder)
    reference = {output: (folder / output).read_bytes() for output in outputs}
    codes: Counter[str] = Counter()
    whole, left, faults = 0, 0, []
    for run in range(runs):
        sent = list(SIGNALS)[run % 3]
        for output in outputs:
            (folder / output).write_text(OLD)
        process = start(arguments, folder)
        time.sleep(float(rng.uniform(0.0, 1.05 * length)))
        process.send_signal(SIGNALS[sent])
        error = process.communicate()[1].decode()
        codes[f"{sent} {process.returncode}"] += 1
        states = {(folder / output).read_bytes() for output in outputs} - set(reference.values())
        new = [output for output in outputs if (folder / output).read_bytes() == reference[output]]
        whole += len(new) == len(outputs)
        if states - {OLD.encode()}:
            faults.append(f"{name}, {sent}: an output is neither the old one nor whole")
        if sent != "SIGKILL" and 0 < len(new) < len(outputs):
            faults.append(f"{name}, {sent}: {new} of {outputs} are new")
        if "internal error" in error:
            faults.append(f"{name}, {sent}: {error.splitlines()[-1]}")
        remains = hidden(folder)
        left += bool(remains)
        if len(remains) > (1 if sent == "SIGKILL" else 0):
            faults.append(f"{name}, {sent}: {remains} are left")
        if sent == "SIGKILL" and remains:
            start(arguments, folder).communicate()
            if hidden(folder):
                faults.append(f"{name}: the next run leaves {hidden(folder)}")
    counted = {"finished": whole, "hidden_after_sigkill": left, "codes": dict(sorted(codes.items())), "faults": faults}
    return {"command": name, "runs": runs, "length_s": round(length, 2), **counted}


def contents(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def go_on_after_random(name: str, folder: Path, runs: int, seed: int = 0) -> dict[str, object]:
    """The same of a command that fills a folder and goes on where it was stopped: after each signal it is run again."""
    arguments, place = FOLDERS[name]
    rng = np.random.default_rng(seed)
    length = undisturbed(arguments, folder)
    reference = contents(folder / place)
    codes: Counter[str] = Counter()
    whole, left, faults = 0, 0, []
    for run in range(runs):
        sent = list(SIGNALS)[run % 3]
        shutil.rmtree(folder / place, ignore_errors=True)
        process = start(arguments, folder)
        time.sleep(float(rng.uniform(0.0, 1.05 * length)))
        process.send_signal(SIGNALS[sent])
        error = process.communicate()[1].decode()
        codes[f"{sent} {process.returncode}"] += 1
        if "internal error" in error:
            faults.append(f"{name}, {sent}: {error.splitlines()[-1]}")
        remains = sorted({part.name for part in folder.rglob(".*")})
        left += bool(remains)
        if len(remains) > (1 if sent == "SIGKILL" else 0):
            faults.append(f"{name}, {sent}: {remains} are left")
        there = {file: data for file, data in contents(folder / place).items() if "/." not in f"/{file}"}
        whole += there == reference
        if strange := sorted(file for file, data in there.items() if reference.get(file) != data):
            faults.append(f"{name}, {sent}: {strange} are not as of a run that was never stopped")
        again = start(arguments, folder)
        error = again.communicate()[1].decode()
        if again.returncode or contents(folder / place) != reference or list(folder.rglob(".*")):
            faults.append(f"{name}, {sent}: run again ({again.returncode}), another folder: {error[-200:]}")
    counted = {"finished": whole, "hidden_after_sigkill": left, "codes": dict(sorted(codes.items())), "faults": faults}
    return {"command": name, "runs": runs, "length_s": round(length, 2), **counted}


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--command", choices=(*COMMANDS, *FOLDERS), action="append")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = []
    for name in options.command or (*COMMANDS, *FOLDERS):
        with tempfile.TemporaryDirectory() as folder:
            prepare(Path(folder))
            ended = go_on_after_random if name in FOLDERS else end_at_random
            found.append(ended(name, Path(folder), options.runs))
        print(json.dumps(found[-1]), flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    sys.exit(any(entry["faults"] for entry in found))


if __name__ == "__main__":
    main()
