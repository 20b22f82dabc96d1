"""What there is to see of a vehicle's run: `RunView` gathered from its estimates, or from the columns of its track."""

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from relnav.accuracy.published import Claim
from relnav.files.models import load_published
from relnav.files.port_columns import RENAMED
from relnav.files.run_view import Row, RunView, RunWatcher
from relnav.files.spans import Event, Spans
from relnav.files.vehicle_track import SEEKING, TrackRows
from relnav.spacecraft import RESERVED, Vehicle
from relnav.vehicle.estimate import VehicleEstimate

ROWS_AT_ONCE = 256


def vehicle_watcher(vehicle: Vehicle | None, most: int) -> "VehicleWatcher":
    """A watcher of a vehicle's runs, with the figures published for it; None if the vehicle is not known."""
    return VehicleWatcher(most, vehicle, () if vehicle is None else load_published(vehicle).claims)


class VehicleWatcher(RunWatcher):
    """Gathers a `RunView` of a vehicle, row after row."""

    def __init__(self, most: int, vehicle: Vehicle | None = None, claims: tuple[Claim, ...] = ()) -> None:
        """Keep about so many groups; of estimates (`passing`) the vehicle tells the columns."""
        super().__init__(most, vehicle, claims)
        self._track = None if vehicle is None else TrackRows(vehicle)
        self._title = "" if vehicle is None else vehicle.name
        self._waiting: list[list[float]] = []
        self._sensors: tuple[str, ...] = ()
        self._words: dict[str, str] = {}
        self._spans: dict[str, Spans] = {}
        self._told: dict[str, int] = {}

    def passing(self, estimates: Iterable[VehicleEstimate]) -> Iterator[VehicleEstimate]:
        """The estimates, each taken in as it passes."""
        assert self._track is not None
        for one in estimates:
            self._waiting.append(self._track.of(one))
            if len(self._waiting) == ROWS_AT_ONCE:
                self._take_waiting()
            yield one

    def _take_waiting(self) -> None:
        if self._track is not None and self._waiting:
            rows, self._waiting = np.array(self._waiting, dtype=np.float64), []
            self.take_columns(dict(zip(self._track.columns, rows.T, strict=True)))

    def take_columns(self, columns: Mapping[str, Any]) -> None:
        """Go on with the next rows as columns of a track."""
        t = np.asarray(columns["t_s"])
        if not self._spans:
            self._sensors = tuple(name.removeprefix("used_") for name in columns if name.startswith("used_"))
            self._words = dict(self._told_of(columns))
            self._spans = {name: Spans((0,), partial(_said, text)) for name, text in self._words.items()}
        renamed = {RENAMED.get(name, name): np.asarray(column) for name, column in columns.items()}
        self._places.take(renamed)
        self._keep(t, renamed | self._port.of(columns), np.zeros((3, len(t))))
        for name, spans in self._spans.items():
            codes = (np.nan_to_num(np.asarray(columns[name])) > 0).astype(np.int64)
            self._told[name] = self._told.get(name, 0) + int(codes.sum())
            spans.take(t, codes)

    def _told_of(self, columns: Mapping[str, Any]) -> list[tuple[str, str]]:
        """Columns of which stretches are told, and in which words."""
        words = {"used": "{} used", "refused": "{} refused", "alarm": "ALARM {}"}
        names = [*self._sensors, *RESERVED]
        said = [(f"{what}_{s}", text.format(s)) for s in names for what, text in words.items()]
        more = [("gyro_lost", "gyro lost"), (SEEKING, "target looked for")]
        return [(name, text) for name, text in [*said, *more] if name in columns]

    def _rows(self) -> tuple[Row, ...]:
        colours = {"used": "spread", "refused": "published", "alarm": "gate", "gyro": "published", SEEKING: "gate"}
        out = []
        for name, text in self._words.items():
            what, count = name.partition("_")[0], self._told.get(name, 0)
            if count or what == "used":
                out.append(Row(name, f"{text} ({count})", colours[what]))
        return tuple(sorted(out, key=lambda row: row.colour == "gate"))

    def _events(self) -> tuple[list[Event], int]:
        spans = list(self._spans.values())
        return [event for one in spans for event in one.events], sum(one.left_out for one in spans)

    def view(self, log: str = "", title: str = "", metadata: dict[str, str] | None = None) -> RunView:
        """What was gathered, as `RunWatcher.view`."""
        self._take_waiting()
        view = super().view(log, title, metadata)
        view.sensors, view.of_vehicle = self._sensors, True
        return view


def _said(text: str, _: int) -> str:
    return text
