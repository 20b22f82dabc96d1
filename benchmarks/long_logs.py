"""Logs of millions of epochs through the files: peak memory, cost, and whether every covariance stays definite."""

import json
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq

from relnav.files.tables import COLUMNS

PEAK = "int(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1]) / 1024"
"""Peak memory of a process, MiB; getrusage would tell that of its parent before the exec."""

STREAM = f"""
import json, sys, time
import numpy as np
import pyarrow.parquet as pq
import relnav
relnav.filter_epochs(relnav.load_model("three_beacon_psd"), np.arange(3.0), np.zeros((3, 3, 2)), smooth=True).view
from relnav.files.filter_file import filter_file
log, track, smooth = sys.argv[1], sys.argv[2], sys.argv[3] == "smooth"
began = time.process_time()
summary = filter_file(log, "three_beacon_psd", track, smooth=smooth)
print(json.dumps(dict(epochs=summary.epochs, cpu_s=time.process_time() - began, peak_mib={PEAK})))
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


def definite(path):
    """Epochs of a track with a covariance, and those of them where it is not positive definite (Cholesky)."""
    upper = np.triu_indices(6)
    columns = [column for column in COLUMNS if column.startswith("cov_")]
    epochs = lost = 0
    file = pq.ParquetFile(path)
    for group in range(file.num_row_groups):
        table = file.read_row_group(group, columns=columns)
        values = np.array([table.column(name).to_numpy() for name in columns]).T
        values = values[np.isfinite(values).all(axis=1)]
        p = np.zeros((len(values), 6, 6))
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
    """Peak memory and cost of a long log, filtered and smoothed, each in a process of its own; definite throughout."""
    rows = []
    write_long_log(log, epochs, folder / "long.parquet")
    print(f"\n{epochs} epochs from Parquet to Parquet (spots, all columns), each in a process of its own")
    for mode in ("filter", "smooth"):
        command = [sys.executable, "-c", STREAM, str(folder / "long.parquet"), str(folder / "track.parquet"), mode]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rows.append({"mode": mode, **json.loads(done.stdout)})
        row = rows[-1]
        row["covariances"], row["not_definite"] = definite(folder / "track.parquet")
        print(f"  {mode:<8}{row['cpu_s']:>9.1f} s CPU{row['peak_mib']:>9.0f} MiB peak", end="")
        print(f"{row['not_definite']:>6} of {row['covariances']} covariances not positive definite")
        (folder / "track.parquet").unlink()
    return rows
