"""How far a filter is, on a terminal: epochs done of a log whose length nobody knows before it is read."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click

BAR_FROM_BYTES = 5_000_000
"""Shorter logs are done before anybody looks."""


@contextmanager
def epoch_bar(
    log: Path, *, quiet: bool, note: str = "", from_bytes: int = BAR_FROM_BYTES
) -> Iterator[Callable[[int], None] | None]:
    """What takes the number of epochs just done; None where no bar is shown: off a terminal, for a short log."""
    if quiet or not sys.stderr.isatty() or log.stat().st_size < from_bytes:
        yield None
        return
    with click.progressbar(length=0, label="epochs", file=sys.stderr, show_eta=False, show_percent=False) as bar:

        def progress(done: int) -> None:
            bar.length = (bar.length or 0) + done
            bar.label = f"{bar.length} epochs{note}"
            bar.update(done)

        yield progress
