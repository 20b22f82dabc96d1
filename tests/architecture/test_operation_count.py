"""The gate against slow kernels: arithmetic operations of every straight-line function, counted, not timed.

A function that needs more than 2 % more than `operation_counts.toml` says has become slower: find out why, or write the
new figure down with the reason in the commit. One that needs less has its figure lowered.
"""

import tomllib
from pathlib import Path

import pytest

from relnav.codegen.kernel import STRAIGHT_LINES, shapes_of, sizes_of
from relnav.codegen.trace import INPUTS, Trace
from relnav.navigation import log, pose_log  # noqa: F401  (registers the filters' functions)
from relnav.navigation.attitude import target_attitude  # noqa: F401  (as above)

COUNTS = tomllib.loads((Path(__file__).parent / "operation_counts.toml").read_text())["operations"]
FUNCTIONS = {
    f"{function.__module__}.{function.__name__}" + (f" of {n}" if n else ""): (function, n)
    for function in STRAIGHT_LINES
    for n in sizes_of(function)
}


def operations(function, n):
    trace = Trace(function, shapes_of(function, n))
    return sum(trace.nodes[place][0] not in INPUTS for place in trace.needed())


@pytest.mark.parametrize("name", FUNCTIONS)
def test_operations_do_not_grow(name):
    count = operations(*FUNCTIONS[name])
    assert name in COUNTS, f'write it down: "{name}" = {count}'
    assert count <= 1.02 * COUNTS[name], f"{count} operations, {COUNTS[name]} written down"
    assert count >= 0.98 * COUNTS[name], f"fewer operations: lower its figure to {count}"


def test_nothing_else_is_written_down():
    assert set(COUNTS) == set(FUNCTIONS)


def test_an_epoch_in_steady_state():
    """Three whole beacons: carried, located, seen, taken. Bierman and Thornton by hand need some 1,000 operations."""
    module = "relnav.navigation."
    epoch = COUNTS[module + "propagation.carry"] + COUNTS[module + "observation.beacon_geometry._locate"]
    epoch += 3 * (
        COUNTS[module + "observation.beacon_geometry.see_beacon"] + COUNTS["relnav.estimation.rows.take_pair of 6"]
    )
    assert epoch <= 1200
