"""Where labels beside marks find room: over no mark, and over no other label."""

from collections.abc import Sequence

import numpy as np

from relnav.arrays import Matrix, Vector

STEPS = (1.0, 2.6, 4.2)
"""Distances at which a place is looked for, in radii of a mark; beyond the first a line leads to the mark."""
SIDES = ((1.0, 0.7), (1.0, -0.7), (-1.0, 0.7), (-1.0, -0.7), (0.0, 1.0), (0.0, -1.0))
"""Directions in which it is looked for, in that order: of the box beside the mark, y up."""


Place = tuple[Vector, bool]
"""Lower left corner of a label from the centre of its mark, and whether a line has to lead to it."""


def free_places(
    marks: Matrix, radius: float, labelled: Sequence[int], sizes: Matrix, edge: Vector | None = None
) -> list[Place | None]:
    """A place for each label, one after the other; None where there is none.

    Parameters
    ----------
    marks : (n, 2)
        Centres of all marks, each of this radius; y up, any unit.
    labelled : sequence of int
        Which of them have a label, those that matter most first.
    sizes : (len(labelled), 2)
        Width and height of each label.
    edge : (2,) or None
        Labels stay inside -edge to edge, if it is given.

    Returns
    -------
    list of Place or None
        In the order of `labelled`.
    """
    low, high = marks - radius, marks + radius  # boxes that are taken
    found: list[Place | None] = []
    for k, size in zip(labelled, sizes, strict=True):
        place = None
        for corner, led in _candidates(radius, size):
            at = marks[k] + corner
            inside = edge is None or bool(((at >= -edge) & (at + size <= edge)).all())
            if inside and not ((low < at + size) & (high > at)).all(axis=1).any():
                place = corner, led
                low, high = np.vstack([low, at]), np.vstack([high, at + size])
                break
        found.append(place)
    return found


def _candidates(radius: float, size: Vector) -> list[Place]:
    """Places about a mark, the nearest first."""
    out = []
    for step in STEPS:
        for side in SIDES:
            towards = np.array(side)
            middle = towards * (1.25 * step * radius + 0.5 * size * np.array([1.0, 1.0 if side[0] == 0.0 else 0.3]))
            out.append((middle - 0.5 * size, step > STEPS[0]))
    return out
