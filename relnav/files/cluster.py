"""A campaign on a cluster: batches go to dask's workers, which write their parts into the shared folder themselves.

Results do not travel, and a part has the same bytes whoever makes it and however often, so that a worker or a scheduler
may die at any time. A batch whose workers keep dying is cut in two until one run is left: that one is at fault.
"""

import logging
import os
import shlex
import subprocess
import sys
import tempfile
import threading
from asyncio import CancelledError
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from relnav.accuracy.campaign_plan import Batch, Plan, fly_batch, prepare
from relnav.errors import InputError, UsageError
from relnav.files.campaign_folder import failed_batch, join_batches, write_batch, write_flown
from relnav.files.optional import require
from relnav.files.wording import shown

IN_FLIGHT = 4
"""Batches handed out for each worker."""
MEMORY = "2GB"
"""Of a worker of this machine: it holds an eighth of it, and much more only should it have to compile."""
CONNECT_S, START_S = 30.0, 120.0
ALONE = 2
"""How often a run that was there at a death is flown alone before it is said to be at fault."""


def require_distributed() -> Any:
    """The distributed package; UsageError with the line that installs it."""
    return require("distributed", "cluster", "campaigns on a cluster need dask", ", or use --workers")


@contextmanager
def _client(address: str, workers: int) -> Iterator[Any]:
    """A client of the scheduler at the address, or of one made here, which nobody else on the network can reach."""
    distributed = require_distributed()
    if address != "local":
        where = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
        try:
            client = distributed.Client(**where, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise UsageError(
                f"cluster {address}: no dask scheduler answers there ({type(error).__name__}); name its file "
                "(--scheduler-file) or an address, tcp://HOST:PORT"
            ) from error
        with client:
            yield client
        return
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),  # a death is looked into at once
        distributed.LocalCluster(
            n_workers=0,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
        _LocalWorkers(cluster.scheduler_address, workers),
    ):
        try:
            client.wait_for_workers(1, timeout=START_S)
        except TimeoutError as error:
            raise UsageError(
                f"--cluster local: no worker started within {START_S:g} s; use --workers without --cluster"
            ) from error
        yield client


class _LocalWorkers:
    """Worker processes of this machine; one that dies is started again, whatever killed it and whenever.

    dask's own keepers of workers are not used: with two deaths shortly after each other they were seen to start none.
    """

    def __init__(self, scheduler: str, count: int) -> None:
        words = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--memory-limit", MEMORY)
        self._command = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler, *words]
        self._count, self._over = count, threading.Event()
        self._running: list[subprocess.Popen[bytes]] = []
        self._keeper = threading.Thread(target=self._keep, daemon=True)

    def __enter__(self) -> "_LocalWorkers":
        self._place = tempfile.TemporaryDirectory(prefix="relnav-workers-")
        self._keeper.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._keeper.join()
        for process in self._running:
            process.kill()  # they hold nothing: a part appears whole or not at all
            process.wait()
        self._place.cleanup()

    def _keep(self) -> None:
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        while not self._over.wait(0.2):
            self._running = [process for process in self._running if process.poll() is None]
            while len(self._running) < self._count:
                self._running.append(
                    subprocess.Popen(
                        self._command,
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                        cwd=self._place.name,
                        env=environment,
                    )
                )


def fly_on_cluster(
    plan: Plan,
    folder: Path,
    starts: list[int],
    address: str,
    workers: int,
    progress: Callable[[int], None] | None,
) -> None:
    """Fly the batches that start with these runs.

    Raises
    ------
    UsageError
        If dask is missing, or no scheduler answers.
    InputError
        If a worker does not see the folder, or cannot write there.
    """
    require_distributed()
    if address == "local":
        prepare(plan)  # once for all processes
    with _client(address, workers) as client:
        _Driver(plan, folder.resolve(), client, progress).fly(starts)


class _Driver:
    """Hands batches to a cluster and takes note of what is done; it holds a few futures at a time, and no results."""

    def __init__(self, plan: Plan, folder: Path, client: Any, progress: Callable[[int], None] | None) -> None:
        self._plan, self._folder, self._client, self._progress = plan, folder, client, progress
        self._waiting = require_distributed().as_completed(loop=client.loop)
        self._runs: dict[Any, range] = {}
        self._pieces: dict[int, list[Batch]] = {}
        self._suspects: list[range] = []

    def fly(self, starts: list[int]) -> None:
        """Fly the batches; then, each alone, the runs whose worker died, which another run may have killed."""
        left = iter(starts)
        while True:
            while len(self._runs) < self._most() and (start := next(left, -1)) >= 0:
                self._submit(self._plan.runs_of(start))
            if not self._runs:
                break
            self._take()
        for runs in self._suspects:
            for attempt in range(ALONE):
                self._submit(runs)
                if self._take(last=attempt == ALONE - 1):
                    break

    def _most(self) -> int:
        return IN_FLIGHT * max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))

    def _submit(self, runs: range) -> None:
        """A whole batch is written by its worker; a piece of one that kills workers is small, and comes here."""
        if self._is_whole(runs):
            work, arguments = write_batch, (self._plan, str(self._folder), runs)
        else:
            work, arguments = fly_batch, (self._plan, runs)  # type: ignore[assignment]  # two kinds of work
        future = self._client.submit(work, *arguments, pure=False, retries=2)
        self._runs[future] = runs
        self._waiting.add(future)

    def _is_whole(self, runs: range) -> bool:
        return runs == self._plan.runs_of(runs.start - runs.start % self._plan.batch)

    def _take(self, *, last: bool | None = None) -> bool:
        """Wait for one piece of work, and see what became of it; whether it is flown, or a run at fault.

        last: of a run flown alone, whether its death now says that it is at fault.
        """
        future = next(self._waiting)
        runs = self._runs.pop(future)
        result, error = _outcome(future)
        if error is None and self._is_whole(runs):
            self._tell(len(runs))
        elif error is None:
            self._keep(result)
        elif not isinstance(error, require_distributed().KilledWorker):
            raise InputError(
                f"the cluster failed: {type(error).__name__}: {shown(error)}; call it again to go on"
            ) from error
        elif len(runs) > 1:
            middle = runs.start + len(runs) // 2
            self._submit(range(runs.start, middle))
            self._submit(range(middle, runs.stop))
        elif last:
            self._keep(failed_batch(self._plan, runs.start, "every process that flew it died"))
        elif last is None:
            self._suspects.append(runs)
        future.release()
        return error is None or bool(last)

    def _keep(self, piece: Batch) -> None:
        """Put a piece of a batch with the others, and write the batch once it is whole."""
        start = int(piece.run[0]) - int(piece.run[0]) % self._plan.batch
        pieces = self._pieces.setdefault(start, [])
        pieces.append(piece)
        batch = self._plan.runs_of(start)
        if sum(len(one.run) for one in pieces) == len(batch):
            write_flown(self._plan, self._folder, join_batches(self._pieces.pop(start)))
            self._tell(len(batch))

    def _tell(self, runs: int) -> None:
        if self._progress is not None:
            self._progress(runs)


def _outcome(future: Any) -> tuple[Any, BaseException | None]:
    """Result or error; a result may be lost with the worker that holds it, and its making again fail."""
    try:
        return future.result(), None
    except (Exception, CancelledError) as error:
        return None, error


def job_script(workers: int | None, arguments: list[str]) -> str:
    """A Slurm script that flies a campaign: a scheduler and its workers in one job, by dask's own commands.

    Parameters
    ----------
    workers : int or None
        Tasks of the job; 16 if left out.
    arguments : list of str
        Of `relnav`, but for --cluster and --workers.
    """
    command = shlex.join([sys.executable, "-m", "relnav", *arguments])
    python = shlex.quote(sys.executable)
    return f"""#!/bin/bash
#SBATCH --job-name=relnav-campaign
#SBATCH --ntasks={workers or 16}
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=1G
#SBATCH --time=02:00:00
# Add --partition and --account as your site asks for; --out must be on a file system that all nodes see.
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1
place=$PWD/relnav-scheduler-$SLURM_JOB_ID.json
{python} -m distributed.cli.dask_scheduler --scheduler-file "$place" --no-dashboard &
srun {python} -m distributed.cli.dask_worker --scheduler-file "$place" --nthreads 1 --no-dashboard &
until [ -s "$place" ]; do sleep 1; done
{command} --cluster "$place"
"""
