"""The same for many numbers at once: on threads where what is done is compiled, else in processes."""

import gc
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from multiprocessing import get_context
from typing import Any, TypeVar

from relnav.errors import InputError

QUEUED = 4
"""Numbers handed out ahead, for each worker."""

T = TypeVar("T")


def processors() -> int:
    """Processors that this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_threads(do: Callable[[int], T], numbers: Iterable[int], count: int) -> Iterator[T]:
    """What comes of each, as it is done: compiled loops let other threads run."""
    yield from _pooled(ThreadPoolExecutor(count), do, numbers, count)


def in_processes(do: Callable[[int], T], numbers: Iterable[int], count: int, needs: Any, advice: str) -> Iterator[T]:
    """What comes of each, as it is done; one process is this one.

    Parameters
    ----------
    do : callable
        That can be pickled.
    numbers, count
        To be done; how many processes.
    needs : Any
        Handed to a process when it begins, which then has imported what there is to import.
    advice : str
        What to do if a process dies.

    Raises
    ------
    InputError
        If one does.
    """
    if count == 1:
        yield from map(do, numbers)
        return
    pool = ProcessPoolExecutor(count, get_context("spawn"), _begin, (needs,))
    try:
        yield from _pooled(pool, do, numbers, count)
    except BrokenExecutor as error:
        raise InputError(advice) from error


def _begin(_needs: Any) -> None:
    """Of a process, which has imported by now what it needs: garbage is not looked for in that every time anew."""
    gc.freeze()


def _pooled(pool: Executor, do: Callable[[int], T], numbers: Iterable[int], count: int) -> Iterator[T]:
    """The same in a pool, which is then closed."""
    left, running = iter(numbers), set[Future[T]]()
    with pool:
        try:
            while True:
                while len(running) < QUEUED * count and (number := next(left, None)) is not None:
                    running.add(pool.submit(do, number))
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
