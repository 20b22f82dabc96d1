"""The picture of a run that a command may be asked for: gathered while its parts pass, drawn at the end."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from relnav.files.atomic import Outputs
    from relnav.files.run_view import RunWatcher


class Picture:
    """A picture to be drawn at `path`, or none.

    Raises
    ------
    UsageError
        For a file that is no picture, before any work is done.
    """

    def __init__(self, path: Path | None, corridor_deg: float) -> None:
        self.path, self._corridor_deg = path, corridor_deg
        self._watcher: RunWatcher | None = None
        if path is not None:
            from relnav.files.atomic import check_folder
            from relnav.files.picture_style import check_picture

            check_folder(path)
            check_picture(path)

    def of(self, mission: Any) -> None:
        """Say which mission it will be of."""
        if self.path is None:
            return
        from relnav.files.track_picture import GROUPS
        from relnav.spacecraft import Vehicle

        if isinstance(mission, Vehicle):
            from relnav.files.vehicle_view import vehicle_watcher

            self._watcher = vehicle_watcher(mission, GROUPS)
        else:
            from relnav.files.run_view import watcher_of

            self._watcher = watcher_of(mission, GROUPS)

    def watch(self, part: Any) -> None:
        """Take in the next epochs."""
        if self._watcher is not None:
            self._watcher.take(part)

    def passing(self, parts: Iterable[Any]) -> Iterator[Any]:
        """The parts, or a vehicle's estimates, each taken in as it passes."""
        own = getattr(self._watcher, "passing", None)
        if own is not None:
            yield from own(parts)
            return
        for part in parts:
            self.watch(part)
            yield part

    def draw(self, outputs: "Outputs", log: Path) -> None:
        """Draw it among the command's other files."""
        if self.path is not None and self._watcher is not None:
            from relnav.files.track_picture import draw_track

            draw_track(self._watcher.view(log=log.name), outputs.path(self.path, ".png"), self._corridor_deg)

    def said(self, files: list[tuple[str, Path | None]]) -> list[str]:
        """Lines that name what was written, the picture among them."""
        return [f"{what}: {path}" for what, path in [*files, ("picture", self.path)] if path is not None]
