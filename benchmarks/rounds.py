"""Contenders in turn in one process, and the table of what each took beside one of them."""

import functools
import importlib.util
import statistics
import time


@functools.cache
def installed(package):
    """Whether a peer is there; if not, its rows are left out."""
    if importlib.util.find_spec(package) is None:
        print(f"{package} is not installed and left out: pip install 'relnav[bench]'")
        return False
    return True


def measure(entries, rounds, clock=time.thread_time_ns):
    """Microseconds an epoch of each entry, interleaved rounds."""
    for _, function in entries.values():
        function()
    times = {name: [] for name in entries}
    for _ in range(rounds):
        for name, (epochs, function) in entries.items():
            began = clock()
            function()
            times[name].append((clock() - began) / epochs / 1000.0)
    return times


def table(times, reference, rows):
    """Print a table against one of its rows, and keep it."""
    base, width = times[reference], max(40, 2 + max(map(len, times)))
    print(f"\n{'':<{width}}{'us per epoch, min':>18}{'median':>10}{reference + ' / it, min':>48}{'median':>9}")
    for name, values in times.items():
        low, middle = min(values), statistics.median(values)
        ratios = min(base) / low, statistics.median(base) / middle
        rows.append({"name": name, "us_min": low, "us_median": middle, "of": reference})
        rows[-1] |= {"ratio_min": ratios[0], "ratio_median": ratios[1]}
        print(f"{name:<{width}}{low:>18.3f}{middle:>10.3f}{ratios[0]:>48.1f}{ratios[1]:>9.1f}")
