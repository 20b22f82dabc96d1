"""The errors of a filter as named blocks: where each stands, how large it is at the start, and its role.

A block is `estimated`, or `considered` (Schmidt 1966): its error is carried in the covariance, with all that it does to
the rest, and never corrected. Errors of attitudes are those of `relnav.geometry.rotation_vector`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from relnav.arrays import Flags, Matrix, Vector

Role = Literal["estimated", "considered"]
"""Of an error: learnt by the filter, or only counted in its covariance (Schmidt 1966)."""


@dataclass(frozen=True)
class Block:
    """Some errors of one kind.

    Attributes
    ----------
    name : str
        "position", or of a vehicle's sensor "camera.mount".
    place : slice
        Of the error state.
    sigma : float
        1-sigma of each at the start, SI; NaN: the first image's own.
    role : {"estimated", "considered"}
    """

    name: str
    place: slice
    sigma: float
    role: Role = "estimated"


@dataclass(frozen=True)
class StateLayout:
    """All blocks of a filter's errors.

    Attributes
    ----------
    blocks : tuple of Block
        In order.
    """

    blocks: tuple[Block, ...]

    @cached_property
    def size(self) -> int:
        """Number of errors."""
        return int(self.blocks[-1].place.stop)

    @cached_property
    def by_name(self) -> dict[str, slice]:
        """Place of each block."""
        return {block.name: block.place for block in self.blocks}

    @cached_property
    def considered(self) -> Flags:
        """Which errors are never corrected, (n,)."""
        flags = np.zeros(self.size, dtype=bool)
        for block in self.blocks:
            flags[block.place] = block.role == "considered"
        return flags

    @cached_property
    def prior(self) -> Matrix:
        """Covariance at the start, (n, n); NaN where the first image says it."""
        sigma = np.empty(self.size)
        for block in self.blocks:
            sigma[block.place] = block.sigma
        return np.diag(sigma**2)

    def sigmas(self, covariance: Matrix) -> dict[str, Vector]:
        """1-sigma of every block, by name, of a covariance (n, n), or of the first errors that it holds."""
        sigma = np.sqrt(np.diagonal(covariance))
        return {block.name: sigma[block.place] for block in self.blocks if block.place.stop <= len(sigma)}

    def __str__(self) -> str:
        """A line a block: name, how many errors, 1-sigma of each at the start, role."""
        lines = [("error", "number", "1-sigma at the start", "role")]
        for block in self.blocks:
            sigma = "of the first image" if np.isnan(block.sigma) else f"{block.sigma:.3g}"
            lines.append((block.name, str(block.place.stop - block.place.start), sigma, block.role))
        name, number, start = (max(len(line[k]) for line in lines) for k in range(3))
        rows = (f"{a:{name}}  {b:>{number}}  {c:{start}}  {d}" for a, b, c, d in lines)
        return "\n".join(rows)


def stacked(blocks: Iterable[tuple[str, int, float, Role]]) -> StateLayout:
    """A layout of blocks (name, how many errors, 1-sigma at the start, role), one behind the other."""
    at, out = 0, []
    for name, size, sigma, role in blocks:
        out.append(Block(name, slice(at, at + size), sigma, role))
        at += size
    return StateLayout(tuple(out))
