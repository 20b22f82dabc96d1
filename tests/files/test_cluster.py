"""A campaign on a local dask cluster: the same bytes as on threads; a run that kills its process is named."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")
pytest.importorskip("distributed", reason="campaigns on a cluster need dask (extra cluster)")

FLY = """
import os, sys
import relnav
from relnav.accuracy import run_score
from relnav.simulation.dispersions import Results, Scenario, Spread
from relnav.simulation.trajectory import Approach

fly, deadly = run_score.fly_run, int(os.environ.get("DEADLY", "-1"))

def fly_or_die(model, scenario, seed, run):
    if run == deadly:
        os.kill(os.getpid(), 9)
    return fly(model, scenario, seed, run)

run_score.fly_run = fly_or_die
scenario = Scenario(
    Approach(duration_s=4.0, rate_hz=2.0), Spread((0.3, 0.1, 0.1)), results=Results((9.0, 9.8, 10.5), 1.0)
)
if __name__ == "__main__":
    cluster = sys.argv[2] if len(sys.argv) > 2 else None
    relnav.campaign("three_beacon_psd", 16, 3, dispersions=scenario, out=sys.argv[1], workers=2, cluster=cluster)
"""


@pytest.fixture(scope="module")
def fly(tmp_path_factory):
    """fly(name, *cluster, deadly) -> folder of a finished campaign, by a program of its own."""
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "fly.py").write_text(FLY)

    def call(name, *cluster, deadly=-1):
        environment = os.environ | {"RELNAV_JIT": "0", "DEADLY": str(deadly)}
        environment["DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES"] = "0"  # sooner suspected: each death costs a start
        command = [sys.executable, str(folder / "fly.py"), str(folder / name), *cluster]
        subprocess.run(command, env=environment, check=True, timeout=300)
        return folder / name

    return call


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_the_same_bytes_and_the_run_that_kills(fly):
    """Run 6 kills whoever flies it: every other row is as on threads, and it is named."""
    threads = fly("threads")
    expected = contents(threads)
    assert contents(fly("processes", "local")) == expected
    from pyarrow import parquet

    part = "runs/part-000000000004.parquet"
    deadly = fly("deadly", "local", deadly=6)
    failed = parquet.read_table(deadly / "failed.parquet").to_pylist()
    assert failed == [{"run": 6, "reason": "every process that flew it died"}]
    parts = {name: value for name, value in contents(deadly).items() if name.startswith("runs")}
    assert [name for name in parts if parts[name] != expected[name]] == [part]
    rows = [parquet.read_table(folder / part).to_pylist() for folder in (deadly, threads)]
    assert [k for k, (one, two) in enumerate(zip(*rows, strict=True)) if repr(one) != repr(two)] == [2]
