"""A campaign on a local dask cluster: the same bytes as on threads."""

import contextlib
import os
import subprocess
import sys
from types import SimpleNamespace
from unittest import mock

import pytest

from relnav.errors import InputError, UsageError

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")
pytest.importorskip("distributed", reason="campaigns on a cluster need dask (extra cluster)")

FLY = """
import sys
import relnav
from relnav.simulation.dispersions import Results, Scenario, Spread
from relnav.simulation.trajectory import Approach

scenario = Scenario(
    Approach(duration_s=4.0, rate_hz=2.0), Spread((0.3, 0.1, 0.1)), results=Results((9.0, 9.8, 10.5), 1.0)
)
if __name__ == "__main__":
    cluster = sys.argv[2] if len(sys.argv) > 2 else None
    relnav.campaign("three_beacon_psd", 16, 3, dispersions=scenario, out=sys.argv[1], workers=2, cluster=cluster)
"""


@pytest.fixture(scope="module")
def fly(tmp_path_factory):
    """fly(name, *cluster) -> folder of a finished campaign, by a program of its own."""
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "fly.py").write_text(FLY)

    def call(name, *cluster):
        environment = os.environ | {"RELNAV_JIT": "0"}
        command = [sys.executable, str(folder / "fly.py"), str(folder / name), *cluster]
        subprocess.run(command, env=environment, check=True, timeout=300)
        return folder / name

    return call


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_the_same_bytes_as_on_threads(fly):
    assert contents(fly("processes", "local")) == contents(fly("threads"))


def test_a_cluster_that_fails_is_told(monkeypatch, tmp_path):
    """What a worker raises, other than its death, ends the campaign with how to go on."""
    from relnav.files import cluster

    future = mock.Mock(**{"result.side_effect": OSError("no space left there")})
    waiting = mock.MagicMock(__next__=lambda _: future)
    client = mock.Mock(**{"scheduler_info.return_value": {"workers": {}}, "submit.return_value": future})
    dask = mock.Mock(**{"as_completed.return_value": waiting}, KilledWorker=KeyError)
    monkeypatch.setattr(cluster, "require_distributed", lambda: dask)
    plan = SimpleNamespace(runs_of=lambda start: range(start, start + 4), batch=4)
    with pytest.raises(InputError, match="the cluster failed: OSError: no space left there; call it again to go on"):
        cluster._Driver(plan, tmp_path, client, None).fly([0])
    waiting.add.assert_called_once_with(future)


def test_no_worker_starts(monkeypatch):
    """As on a machine whose memory is used up: the scheduler of this machine waits in vain."""
    from relnav.files import cluster

    monkeypatch.setattr(cluster, "_LocalWorkers", lambda *_: contextlib.nullcontext())
    monkeypatch.setattr(cluster, "START_S", 0.2)
    with (
        pytest.raises(UsageError, match=r"--cluster local: no worker started within 0\.2 s; use --workers without"),
        cluster._client("local", 1),
    ):
        pass


def driver_of(outcomes, tmp_path, monkeypatch, batch=4):
    """A driver whose futures end as outcomes(runs) says, None being a death; and the batches that it wrote."""
    from relnav.files import cluster

    class DeathError(Exception):
        pass

    queue, written = [], []

    def submit(*arguments, **_):
        runs = arguments[-1]
        ended = outcomes(runs)
        end = {"side_effect": DeathError()} if ended is None else {"return_value": ended}
        queue.append(mock.Mock(**{f"result.{key}": value for key, value in end.items()}))
        return queue[-1]

    waiting = mock.MagicMock(__next__=lambda _: queue.pop(0))
    client = mock.Mock(**{"scheduler_info.return_value": {"workers": {}}, "submit.side_effect": submit})
    dask = mock.Mock(**{"as_completed.return_value": waiting}, KilledWorker=DeathError)
    monkeypatch.setattr(cluster, "require_distributed", lambda: dask)
    monkeypatch.setattr(cluster, "write_flown", lambda *of: written.append(of[-1]))
    plan = SimpleNamespace(runs_of=lambda start: range(start, start + batch), batch=batch, columns=("x",))
    return cluster._Driver(plan, tmp_path, client, None), written


def test_a_run_that_kills_is_named_and_its_batch_completes(tmp_path, monkeypatch):
    """Run 6 kills whoever flies it; run 1 dies once with another's process, and is flown again alone."""
    import numpy as np

    from relnav.accuracy.campaign_plan import Batch

    unlucky = [2, 1]

    def outcome(runs):
        if 6 in runs or (1 in runs and unlucky and unlucky.pop()):
            return None
        return Batch(np.array(runs), np.zeros(len(runs), dtype=int), ("",) * len(runs), np.zeros((len(runs), 1)))

    driver, written = driver_of(outcome, tmp_path, monkeypatch)
    driver.fly([0, 4])
    assert {int(one.run[0]): one.status.tolist() for one in written} == {0: [0, 0, 0, 0], 4: [0, 0, 3, 0]}
    assert written[-1].reasons == ("", "", "every process that flew it died", "")
