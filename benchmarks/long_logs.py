"""Logs of millions of epochs through the files: peak memory, cost, and whether every covariance stays definite.

python benchmarks/long_logs.py --epochs 1000000        of markers
python benchmarks/speed.py --epochs 10000000           of beacons, with the rest of the speeds
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from relnav.files.tables import COLUMNS

PEAK = "int(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1]) / 1024"
"""Peak memory of a process, MiB; getrusage would tell that of its parent before the exec."""

STREAM = f"""
import json, sys, time
import relnav.codegen.kernel  # else the command runs the short log, and so this process, as plain Python
from relnav.cli import run
model, warm, log, track, *options = sys.argv[1:]
assert run(["filter", warm, "--model", model, "--out", track, "--quiet", *options]) == 0
began = time.process_time()
assert run(["filter", log, "--model", model, "--out", track, "--quiet", *options]) == 0
print(json.dumps(dict(cpu_s=time.process_time() - began, peak_mib={PEAK})))
"""


def write_long_log(log, epochs, path):
    """A log of many epochs, written in pieces: the short one again and again with fresh noise."""
    from relnav.files.parquet import write_parquet
    from relnav.files.simulated import LOG_COLUMNS

    rng = np.random.default_rng(4)

    def parts():
        for begin in range(0, epochs, 100_000):
            n = min(100_000, epochs - begin)
            spots = np.resize(log.spots_m, (n, 3, 2)) + 1e-7 * rng.normal(size=(n, 3, 2))
            yield [0.1 * np.arange(begin, begin + n), *(1e6 * spots.reshape(n, 6).T), *np.zeros((3, n))]

    write_parquet(path, LOG_COLUMNS, parts(), {}, ())


def write_long_marker_log(flight, epochs, path):
    """The same of markers: a flight again and again with fresh noise, a minute apart."""
    from relnav.files.log_columns import markers
    from relnav.files.parquet import write_parquet

    rng = np.random.default_rng(4)
    rows, columns = flight.spots_px.shape[:2]

    def parts():
        for begin in range(0, epochs, rows):
            n = min(rows, epochs - begin)
            spots = flight.spots_px[:n] + 0.02 * rng.normal(size=(n, columns, 2))
            t = flight.t_s[:n] + begin / rows * (flight.t_s[-1] + 60.0)
            yield [t, *spots.reshape(n, 2 * columns).T]

    write_parquet(path, ("t_s", *markers(columns).spots), parts(), {}, ())


def definite(path, columns, size):
    """Epochs of a track with a covariance, and those of them where it is not positive definite (Cholesky).

    columns: of the upper triangle of (size, size), row by row.
    """
    upper = np.triu_indices(size)
    epochs = lost = 0
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        table = file.read_row_group(group, columns=columns)
        values = np.array([table.column(name).to_numpy() for name in columns]).T
        values = values[np.isfinite(values).all(axis=1)]
        p = np.zeros((len(values), size, size))
        p[:, upper[0], upper[1]] = p[:, upper[1], upper[0]] = values
        sigma = np.sqrt(np.diagonal(p, axis1=1, axis2=2))
        p /= sigma[:, :, None] * sigma[:, None, :]
        epochs += len(p)
        try:
            np.linalg.cholesky(p)
        except np.linalg.LinAlgError:
            lost += int(np.sum(np.linalg.eigvalsh(p).min(axis=1) <= 0.0))
    return epochs, lost


def streaming(log, epochs, folder):
    """Peak memory and cost of a long log of beacons, filtered and smoothed; definite throughout."""
    for path, count in ((folder / "warm.parquet", 100), (folder / "long.parquet", epochs)):
        write_long_log(log, count, path)
    columns = [column for column in COLUMNS if column.startswith("cov_")]
    return measured("three_beacon_psd", epochs, folder, columns, 6, "--method", "spots")


def streaming_markers(epochs, folder):
    """The same of markers."""
    import relnav
    from relnav.files.marker_logs import TRACK_COLUMNS
    from relnav.simulation.marker_flight import simulate_flight
    from relnav.simulation.trajectory import Approach

    flight = simulate_flight(relnav.load_model("three_marker_vision"), Approach(duration_s=1000.0), seed=4)
    for path, count in ((folder / "warm.parquet", 100), (folder / "long.parquet", epochs)):
        write_long_marker_log(flight, count, path)
    columns = [column for column in TRACK_COLUMNS if column.startswith("cov_") and "port" not in column]
    return measured("three_marker_vision", epochs, folder, columns, 12)


def measured(model, epochs, folder, columns, size, *options):
    """A long log from Parquet to Parquet, filtered and smoothed, each in a process of its own that has its code."""
    rows = []
    print(f"\n{epochs} epochs of {model} from Parquet to Parquet (all columns), each in a process of its own")
    for mode in ("filter", "smooth"):
        paths = [str(folder / name) for name in ("warm.parquet", "long.parquet", "track.parquet")]
        command = [sys.executable, "-c", STREAM, model, *paths, *options, *(["--smooth"] if mode == "smooth" else [])]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        rows.append({"mode": mode, "epochs": epochs, **json.loads(done.stdout)})
        row = rows[-1]
        row["covariances"], row["not_definite"] = definite(folder / "track.parquet", columns, size)
        print(f"  {mode:<8}{row['cpu_s']:>9.1f} s CPU{row['peak_mib']:>9.0f} MiB peak", end="")
        print(f"{row['not_definite']:>6} of {row['covariances']} covariances not positive definite")
        (folder / "track.parquet").unlink()
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--epochs", type=int, default=100_000)
    with tempfile.TemporaryDirectory() as folder:
        streaming_markers(parser.parse_args().epochs, Path(folder))


if __name__ == "__main__":
    main()
