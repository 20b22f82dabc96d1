"""The track that `relnav filter` writes: a table as it goes, or another program's format once the run is whole."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from relnav.dynamics.in_frame import Turning
    from relnav.files.atomic import Outputs


@dataclass
class TrackOutput:
    """Where to write it, and in which frame; `orbit_deg` and `epoch` are what some formats and frames need."""

    path: Path | None
    frame: str
    orbit_deg: tuple[float, float, float] | None
    epoch: str | None
    row_format: str | None = None
    _parts: list[Any] = field(default_factory=list)

    @property
    def _exchanged(self) -> bool:
        from relnav.files.tracks import EXCHANGE

        return self.path is not None and self.path.suffix.lower() in EXCHANGE

    def check(self) -> None:
        """Refuse, before any work is done, what cannot be written.

        Raises
        ------
        UsageError
            Naming the file.
        """
        if self.path is None:
            return
        from relnav.files.atomic import check_folder
        from relnav.files.tables import TRACKS, check_format
        from relnav.files.tracks import EXCHANGE

        if not self._exchanged:
            check_format(self.path, TRACKS, EXCHANGE)
        check_folder(self.path)

    def check_settings(self, mission: Any, *, follow: bool) -> None:
        """Refuse, before the log is read, what its format or its frame needs and was not given.

        Raises
        ------
        UsageError
            In one sentence.
        """
        from relnav.files.tracks import check_exchange, check_turning

        settings = self._settings(mission)
        if self.path is None or follow:  # of what is followed only the frame counts: no format but a table is written
            check_turning(settings)
        else:
            check_exchange(self.path, settings)

    def turning(self, mission: Any) -> "Turning":
        """What turns the rows of a table."""
        from relnav.dynamics.in_frame import Turning

        return Turning(self.frame, mission, self.orbit_deg)

    def _settings(self, mission: Any) -> dict[str, Any]:
        from relnav.mission import VisionMission

        return {
            "frame": self.frame,
            "orientation_deg": self.orbit_deg,
            "epoch": self.epoch,
            "model": mission,
            "attitude": isinstance(mission, VisionMission),
        }

    @property
    def clock(self) -> Path | None:
        """The second file of a format that has two."""
        from relnav.files.tracks import clock_beside

        return None if self.path is None else clock_beside(self.path)

    @property
    def written(self) -> list[tuple[str, Path | None]]:
        """What each of its files is, and where."""
        return [("track", self.path), ("clock", self.clock)]

    @property
    def table_asked(self) -> bool:
        """Whether it is a table."""
        return self.path is not None and not self._exchanged

    def table(self, outputs: "Outputs") -> Path | None:
        """Where the filter writes a table as it goes; None if it does not."""
        if self.path is None or not self.table_asked:
            return None
        return outputs.path(self.path, f".{self.row_format or 'csv'}")

    def watch(self, part: Any) -> None:
        """Keep the next epochs, if the format needs them all."""
        if self._exchanged:
            self._parts.append(part)

    def passing(self, parts: Iterable[Any]) -> Iterator[Any]:
        """The parts, each kept as it passes."""
        for part in parts:
            self.watch(part)
            yield part

    def finish(self, outputs: "Outputs", mission: Any) -> None:
        """Write the format that needed them all."""
        if self.path is None or not self._parts:
            return
        from relnav.files.tracks import joined, write_exchange

        clock = None if self.clock is None else outputs.path(self.clock)
        write_exchange(joined(self._parts), outputs.path(self.path), self._settings(mission) | {"clock": clock})
