"""A followed run on a terminal, drawn by rich: the last state with its 3-sigma, rates, what was left out."""

import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Any

from relnav.navigation.status import Alarm, EpochStatus

RATE_OVER_S = 5.0


class LiveView:
    """Shows parts of a solution as they pass, four times a second, on standard error; or nothing, where it is off."""

    def __init__(self, title: str, *, on: bool) -> None:
        self._title, self._live, self._last = title, None, None
        self._rows, self._times = 0, deque[tuple[float, int]]()
        self.left_out = 0
        if on:
            from rich.console import Console
            from rich.live import Live

            console = Console(file=sys.stderr)
            self._live = Live(
                get_renderable=self.shown, console=console, refresh_per_second=4, transient=True, redirect_stdout=False
            )

    def __enter__(self) -> "LiveView":
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._live is not None:
            self._live.stop()

    def watch(self, part: Any) -> None:
        """Take in the next epochs."""
        if self._live is None:
            return
        self._last, self._rows = part, self._rows + len(part)
        now = time.monotonic()
        self._times.append((now, len(part)))
        while self._times[0][0] < now - RATE_OVER_S:
            self._times.popleft()

    def passing(self, parts: Iterable[Any]) -> Iterator[Any]:
        """The parts, each taken in when it has passed."""
        for part in parts:
            yield part
            self.watch(part)

    def shown(self) -> Any:
        """The picture."""
        from rich.console import Group
        from rich.panel import Panel
        from rich.table import Table
        from rich.text import Text

        table = Table.grid(padding=(0, 2))
        for name, value, unit, sigma in quantities(self._last):
            table.add_row(name, f"{value:.5f} {unit}", f"+- {3.0 * sigma:.5f} {unit} (3-sigma)")
        return Panel(Group(table, Text(self._said())), title=Text(self._title), expand=False, title_align="left")

    def _said(self) -> str:
        last = self._last
        if last is None:
            return "waiting for the first row"
        e = len(last) - 1
        span = max(time.monotonic() - self._times[0][0], 1e-3) if self._times else 1.0
        rate = sum(count for _, count in self._times) / max(span, 1.0)
        words = [
            f"t {float(last.t_s[e]):.3f} s",
            EpochStatus(int(last.status[e])).name,
            f"{self._rows} rows, {rate:.0f}/s",
        ]
        if self.left_out:
            words.append(f"{self.left_out} left out")
        alarm = int(last.alarm[e])
        if alarm:
            words.append("ALARM " + ", ".join(str(one.name) for one in Alarm if alarm & int(one)))
        return " · ".join(words)


def quantities(last: Any) -> list[tuple[str, float, str, float]]:
    """Name, value, unit and 1-sigma of what there is to see of the last epoch of a part of a solution."""
    import numpy as np

    if last is None or not np.isfinite(last.state[-1, 0]):
        return []
    part = last.part(len(last) - 1, len(last))
    if hasattr(part, "docking_sigma"):
        degrees = 180.0 / np.pi
        rows = [("range", part.range_m[0], "m", part.docking_sigma[0, 0])]
        rows += [
            (name, degrees * part.docking[0, k], "deg", degrees * part.docking_sigma[0, k])
            for k, name in ((1, "azimuth"), (2, "elevation"))
        ]
        speeds, sigma = part.state[0, 3:], part.sigma[0, 3:]
        return [*rows, *((f"v{axis}", speeds[k], "m/s", sigma[k]) for k, axis in enumerate("xyz"))]
    sigma = np.sqrt(np.diag(part.docking_covariance[0]))
    rows = [(f"port {axis}", part.port_m[0, k], "m", sigma[k]) for k, axis in enumerate("xyz")]
    return [
        *rows,
        *((f"port v{axis}", part.port_velocity_m_s[0, k], "m/s", sigma[3 + k]) for k, axis in enumerate("xyz")),
    ]
