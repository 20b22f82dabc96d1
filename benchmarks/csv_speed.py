"""How fast text tables are: a log filtered from CSV to CSV, and the table alone beside other writers and readers.

    python benchmarks/csv_speed.py --out csv_speed.json

First it says whether everyone's file is read back by everyone to the same bits. Then process CPU time, minimum and
median over interleaved rounds, us a row; only the ratios mean anything on another machine. A peer that is not installed
is left out with a sentence. Python's way is that of the standard library: `csv`, `repr` and `float`.
"""

import argparse
import csv
import importlib.util
import json
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
import speed

from relnav.files import compiled_text, tables
from relnav.files.filter_file import filter_file
from relnav.files.log_columns import Columns
from relnav.files.logs import LogFile
from relnav.files.simulated import write_log


def chained(model, log, folder):
    """Name -> function: a log from file to file, CSV beside Parquet."""
    for kind in ("csv", "parquet"):
        write_log(speed.long_log(log), folder / f"log.{kind}")
    return {
        f"{kind} to {kind}, all 43 columns{', smoothed' if smooth else ''}": lambda kind=kind, smooth=smooth: (
            filter_file(folder / f"log.{kind}", model, folder / f"track.{kind}", smooth=smooth)
        )
        for kind in ("csv", "parquet")
        for smooth in (False, True)
    }


def writers(names, columns, folder):
    """Name -> function that writes the table into folder/<name>.csv."""
    table = np.stack(columns, axis=1)

    def ours():
        with (folder / "relnav.csv").open("wb") as file:
            file.write((",".join(names) + "\n").encode())
            file.writelines(compiled_text.texts_of(columns, ()))

    def python():
        with (folder / "python.csv").open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(names)
            writer.writerows(["" if x != x else repr(x) for x in row] for row in table.tolist())

    found = {"relnav": ours, "python": python}
    for package in ("pyarrow", "pandas", "polars"):
        if importlib.util.find_spec(package) is None:
            print(f"{package} is not installed and left out: pip install {package}")
            continue
        path = folder / f"{package}.csv"
        if package == "pyarrow":
            import pyarrow
            from pyarrow.csv import write_csv

            made = pyarrow.table(columns, names=names)
            found[package] = lambda made=made, path=path: write_csv(made, path)
        elif package == "pandas":
            import pandas

            frame = pandas.DataFrame(table, columns=names)
            found[package] = lambda frame=frame, path=path: frame.to_csv(path, index=False)
        else:
            import polars

            made = polars.DataFrame(table, schema=names)
            found[package] = lambda made=made, path=path: made.write_csv(path)
    return found


def readers(path):
    """Name -> function that gives the file's numbers (n, columns)."""
    compiled_text.MANY_NUMBERS = 0  # compiled from the first row on

    def ours():
        return np.concatenate([values for values, _ in LogFile(path, _parse_all).rows()])

    def python():
        with path.open(newline="") as file:
            rows = csv.reader(file)
            next(rows)
            return np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])

    found = {"relnav": ours, "python": python}
    found["numpy"] = lambda: np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    if importlib.util.find_spec("pyarrow") is not None:
        from pyarrow.csv import read_csv

        found["pyarrow"] = lambda: np.stack([column.to_numpy() for column in read_csv(path).columns], axis=1)
    if importlib.util.find_spec("pandas") is not None:
        import pandas

        found["pandas"] = lambda: pandas.read_csv(path).to_numpy()
    if importlib.util.find_spec("polars") is not None:
        import polars

        found["polars"] = lambda: polars.read_csv(path).to_numpy()
    return found


def _parse_all(names, _where):
    """Every column of a table, covariances too."""
    index = {name: k for k, name in enumerate(names)}
    return Columns(tuple(names), index, dict.fromkeys(index, 1.0), ())


def table_of_times(title, entries, rows_each, rounds, rows):
    """Time, print and keep."""
    for function in entries.values():
        function()
    times = {name: [] for name in entries}
    for _ in range(rounds):
        for name, function in entries.items():
            began = time.process_time_ns()
            function()
            times[name].append((time.process_time_ns() - began) / rows_each / 1000.0)
    base = statistics.median(next(iter(times.values())))
    print(f"\n{title:<44}{'us a row, min':>14}{'median':>9}{'over the first':>16}")
    for name, values in times.items():
        row = {"table": title, "name": name, "us_min": min(values), "us_median": statistics.median(values)}
        rows.append(row)
        print(f"{name:<44}{row['us_min']:>14.2f}{row['us_median']:>9.2f}{row['us_median'] / base:>16.2f}")


def main() -> None:
    """Check, measure, print, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--rows", type=int, default=20_000, help="of the table alone")
    parser.add_argument("--tables-alone", action="store_true", help="without the log, whose filter may have to compile")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table = np.random.default_rng(1).normal(size=(options.rows, len(tables.COLUMNS))) ** 3
        columns = [np.ascontiguousarray(column) for column in table.T]
        write = writers(list(tables.COLUMNS), columns, folder)
        for function in write.values():
            function()
        for one in write:
            for reader, read in readers(folder / f"{one}.csv").items():
                same = np.array_equal(read(), table)
                print(f"written by {one}, read by {reader}: {'the same bits' if same else 'OTHER BITS'}")
        table_of_times("43 columns written", write, options.rows, options.rounds, rows)
        table_of_times("43 columns read", readers(folder / "relnav.csv"), options.rows, options.rounds, rows)
        if not options.tables_alone:
            model, log = speed.prepare()
            chain = chained(model, log, folder)
            table_of_times("a log filtered", chain, speed.FILE_EPOCHS, options.rounds, rows)
    if options.out is not None:
        options.out.write_text(json.dumps({"rounds": options.rounds, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
