"""Parts of a solution on their way to what sums them up: of a followed log, rows, and summing each costs most."""

from collections.abc import Callable
from typing import Any

from relnav.files.tracks import joined

AT_ONCE = 256


class Gathered:
    """Hands parts of a solution on, in order, some hundred epochs at once; `settle` hands on what is left."""

    def __init__(self, take: Callable[[Any], None]) -> None:
        """take: what wants them."""
        self._take, self._kept, self._epochs = take, list[Any](), 0

    def take(self, part: Any) -> None:
        """Go on with the next epochs."""
        self._kept.append(part)
        self._epochs += len(part)
        if self._epochs >= AT_ONCE:
            self.settle()

    def settle(self) -> None:
        """Hand on what has not been."""
        kept, self._kept, self._epochs = self._kept, [], 0
        if kept:
            self._take(kept[0] if len(kept) == 1 else joined(kept))
