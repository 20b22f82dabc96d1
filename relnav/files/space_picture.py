"""The approach in space as a sheet of a picture: corridor, path, port, and ellipsoids; axes to one scale.

Axes are the docking frame's, x out of the port; y and z are drawn as a reader of `From above` and `From the side` knows
them, z downwards.
"""

import math
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.files.approach_view import Place
from relnav.files.picture_style import ESTIMATE, GATE, INK, QUIET, SPREAD, TIMELINE_COLOURS, one_legend, plainly
from relnav.files.run_view import RunView

EYE_DEG = (19.0, -58.0)
"""Of the reader: above the plane of x and y, and about z."""
PLACE = (-0.03, 0.08, 1.0, 0.9)
"""Of the axes on the sheet, in shares of it; the numbers of z stand at the right of the box."""
ROOM, SQUARE = (9.2, 5.7), 7.47
"""Inches across and down for the box without its numbers; side of the square that matplotlib makes of the place."""
DIAGONAL = 1.0301
"""Of a box that matplotlib does not enlarge, in sides of the square."""
NARROWEST = 0.17
"""Half of the box's width, of its length."""
RINGS, RULINGS = 5, 12
USUAL, LARGEST, APART = 0.04, 0.09, 0.1
"""Of the box's length: the ellipsoid that is usual at the most, the largest drawn whole, and one to the next."""
SHADOW: Any = {"color": TIMELINE_COLOURS["soft"], "lw": 1.3}
CIRCLE = np.linspace(0.0, 2.0 * math.pi, 49)


def draw_space(figure: Any, view: RunView, corridor_deg: float) -> None:
    """The sheet; nothing where no position is known."""
    from mpl_toolkits.mplot3d import Axes3D  # its import makes the projection known

    place, _ = view.place()
    place = place[:, np.isfinite(place).all(axis=0)]
    if not place.size:
        return
    far = 1.04 * float(np.abs(place[0]).max()) or 1.0
    half = far * min(NARROWEST, math.tan(math.radians(corridor_deg)))  # of the corridor, as far as it is drawn
    low, high = _box(place, far)
    axis = figure.add_subplot(projection=Axes3D.name, proj_type="ortho", computed_zorder=False)
    axis.set_position(PLACE)  # left to its layout, matplotlib makes it smaller for what lies beside its square
    _frame(axis, low, high)
    _draw_corridor(axis, half, corridor_deg)
    _plot(axis, np.stack([[low[0], high[0]], [0.0, 0.0], [0.0, 0.0]]), color=QUIET, lw=0.7)
    _plot(
        axis, np.stack([place[0], place[1], np.full(place.shape[1], high[2])]), label="shadow of the estimate", **SHADOW
    )
    _draw_ellipsoids(axis, view.places, far, high[2])
    _plot(axis, place, color=ESTIMATE, lw=1.8, label="estimate")
    _plot(axis, place[:, :1], color=ESTIMATE, marker="o", ms=6.0, mfc="white", ls="", label="start")
    _plot(axis, place[:, -1:], color=ESTIMATE, marker="o", ms=6.0, ls="", label="end")
    _plot(axis, np.zeros((3, 1)), color=INK, marker="s", ms=7.0, ls="", label="port")
    one_legend(figure)


def _box(place: Matrix, far: float) -> tuple[Vector, Vector]:
    """Least and greatest of x, y and z, with path, port and corridor inside."""
    half = NARROWEST * far
    low = np.minimum([0.0, -half, -half], 1.15 * place.min(axis=1))
    high = np.maximum([far, half, half], [0.0, *(1.15 * place[1:].max(axis=1))])
    return low, high


def _plot(axis: Any, points: Matrix, **look: Any) -> None:
    axis.plot(*points, clip_on=False, **look)


def _frame(axis: Any, low: Vector, high: Vector) -> None:
    """Limits, numbers and names; one scale on all axes."""
    from matplotlib.ticker import MaxNLocator

    axis.set_xlim(low[0], high[0])
    axis.set_ylim(high[1], low[1])  # y towards the reader and z down: right-handed
    axis.set_zlim(high[2], low[2])
    axis.view_init(*EYE_DEG)
    axis.set_box_aspect(high - low, zoom=_zoom(*(high - low)))
    for one, name, most in (
        (axis.xaxis, "x out of the port, m", 7),
        (axis.yaxis, "y of the docking frame, m", 4),
        (axis.zaxis, "z of the docking frame, m", 4),
    ):
        one.set_label_text(name)
        one.labelpad = 8.0
        one.set_major_locator(MaxNLocator(most, steps=[1, 2, 5, 10]))
        one.set_pane_color((1.0, 1.0, 1.0, 0.0))


def _zoom(length: float, width: float, height: float) -> float:
    """With which the box fills its room: matplotlib draws boxes of every shape with the same diagonal, in a square."""
    elevation, azimuth = (math.radians(angle) for angle in EYE_DEG)
    across = length * abs(math.sin(azimuth)) + width * abs(math.cos(azimuth))
    into = length * abs(math.cos(azimuth)) + width * abs(math.sin(azimuth))
    down = height * math.cos(elevation) + into * math.sin(elevation)
    return math.hypot(length, width, height) * min(ROOM[0] / across, ROOM[1] / down) / (DIAGONAL * SQUARE)


def _draw_corridor(axis: Any, half: float, corridor_deg: float) -> None:
    """Its cone, to where it is so wide."""
    length = half / math.tan(math.radians(corridor_deg))
    lines = [_ring(length * k / RINGS, half * k / RINGS) for k in range(1, RINGS + 1)]
    rim = lines[-1]
    lines += [np.stack([np.zeros(3), rim[k]]) for k in range(0, len(CIRCLE) - 1, (len(CIRCLE) - 1) // RULINGS)]
    _lines(axis, lines, f"corridor, {corridor_deg:g} deg half angle", colors=SPREAD, linewidths=0.6, alpha=0.6)


def _lines(axis: Any, lines: list[Matrix], label: str, **look: Any) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    axis.add_collection3d(Line3DCollection(lines, label=label, clip_on=False, **look))


def _ring(x: float, radius: float) -> Matrix:
    return np.stack([np.full_like(CIRCLE, x), radius * np.cos(CIRCLE), radius * np.sin(CIRCLE)], axis=1)


def _draw_ellipsoids(axis: Any, places: list[Place], far: float, floor: float) -> None:
    """Three ellipses of each that has room, the last always, and plumb lines from them to the floor."""
    times, largest = magnification(places, far), LARGEST * far
    whole: list[Matrix] = []
    cut: list[Matrix] = []
    drawn = with_room(places, APART * far)
    for place in drawn:
        axes = times * place.axes_m()
        size = float(np.linalg.norm(axes, axis=0).max())
        axes *= min(1.0, largest / size) if size else 1.0
        u, v = np.cos(CIRCLE)[:, None], np.sin(CIRCLE)[:, None]
        for i, j in ((0, 1), (0, 2), (1, 2)):
            (whole if size <= largest else cut).append(place.position_m + u * axes[:, i] + v * axes[:, j])
    scale = "to scale" if times == 1.0 else f"{plainly(times, 3)} times its size"
    for lines, label, dashes in ((whole, f"3-sigma ellipsoid, {scale}", "-"), (cut, "one larger still", (0, (2, 2)))):
        if lines:
            _lines(axis, lines, label, colors=GATE, linewidths=0.8, linestyles=[dashes])
    _lines(
        axis,
        [np.stack([one.position_m, [*one.position_m[:2], floor]]) for one in drawn],
        "",
        colors=SHADOW["color"],
        linewidths=0.6,
    )


def with_room(places: list[Place], apart_m: float) -> list[Place]:
    """The last, and those before it that are so far from it and from one another, from the first on."""
    kept: list[Place] = []
    for place in places[:-1]:
        others = [one.position_m for one in (*kept[-1:], places[-1])]
        if all(float(np.linalg.norm(place.position_m - other)) >= apart_m for other in others):
            kept.append(place)
    return [*kept, *places[-1:]]


def magnification(places: list[Place], far: float) -> float:
    """1, 2 or 5 times a power of ten, by which ellipsoids are drawn larger so that the usual one can be seen."""
    sizes = sorted(float(np.linalg.norm(place.axes_m(), axis=0).max()) for place in places)
    usual = sizes[len(sizes) // 2] if sizes else 0.0
    if usual <= 0.0 or (times := USUAL * far / usual) <= 1.0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(times))
    return power * max(first for first in (1.0, 2.0, 5.0) if first <= times / power * (1.0 + 1e-9))
