"""How our pictures look: one set of colours and lines, and how a figure becomes a file; matplotlib when it is used."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from relnav.errors import UsageError
from relnav.files.atomic import is_stream, replacing

ESTIMATE, PUBLISHED, GATE, SPREAD, QUIET, INK = "#0060a8", "#c2410c", "#b3123f", "#0a7a55", "#8a94a0", "#1f2730"
"""Okabe and Ito's hues, darkened for lines on white: told apart by eyes that do not see red and green."""
SERIES = (ESTIMATE, PUBLISHED, SPREAD, "#8e4a9e", "#a37b00", INK, "#3f9fc9", GATE)
"""Of curves that stand for different things, in this order."""
TIMELINE_COLOURS = {
    "dots": QUIET,
    "soft": "#b9c2cc",
    "spread": SPREAD,
    "published": PUBLISHED,
    "gate": GATE,
    "estimate": ESTIMATE,
}
"""Of a timeline's rows, by the names that the report page has too."""
ENDINGS = (".png", ".pdf", ".svg")
DOTS_AN_INCH = 130
WIDTH_OF_LEGEND, LETTERS_AN_INCH, MOST_COLUMNS = 11.0, 14.0, 7
"""Inches and letters of the legend's size; how many columns are read at a glance."""
DIGITS = (("1",), ("1", "3"), ("1", "2", "5"), ("1", "1.5", "2", "3", "5", "7"))
"""First digits of the numbers of a logarithmic axis: the more, the less it spans."""
FINE: Any = {"colors": "#e3e8ed", "linewidths": 0.7, "alpha": 0.35, "zorder": 0.5}
MOST_DECADES = 1e9
"""Of a logarithmic axis with lines between its decades."""
SMALLEST_PLAIN, LARGEST_PLAIN = 1e-6, 1e6
"""An axis that goes beyond has exponents."""
LABELS_CLOSER = 1.3
"""So many times as many numbers as matplotlib puts on an axis of that height still find room."""
STYLE: Any = {
    "font.size": 8.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # where it is by itself, without measuring every label for it
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa4af",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#e3e8ed",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "ytick.minor.size": 1.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "path.simplify": True,
    "svg.hashsalt": "relnav",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "text.parse_math": False,
}


@contextmanager
def styled() -> Iterator[None]:
    """Our style for what is drawn inside, and nothing of it afterwards."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        yield


def new_figure(width: float, height: float) -> Any:
    """An empty figure of so many inches, with a canvas that needs no screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def one_legend(figure: Any) -> None:
    """One legend for a whole sheet, below it: every name once, in as many columns as find room."""
    entries = {
        label: handle for axis in figure.axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    if entries:
        inches = figure.bbox.width / figure.dpi if hasattr(figure, "dpi") else WIDTH_OF_LEGEND
        columns = _columns([len(label) for label in entries], inches)
        legend = figure.legend(list(entries.values()), list(entries), loc="outside lower left", ncols=columns)
        for handle in legend.legend_handles:
            if hasattr(handle, "set_markersize"):
                handle.set_markersize(max(handle.get_markersize(), 4.0))  # dots as small as in the drawing are not seen


def heading(figure: Any, text: str) -> None:
    """What a sheet shows, above it at the left."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11.5, fontweight="bold", color=INK)


def named_line(
    axis: Any, value: float, text: str, name: str = "published figure", at: float = 1.0, side: str = "right"
) -> None:
    """A published figure as a dashed line with its value, which ends (or begins: "left") at a share of the axis."""
    axis.axhline(value, color=PUBLISHED, ls=(0, (5, 2)), label=name)
    axis.annotate(
        text,
        (at, value),
        xycoords=("axes fraction", "data"),
        xytext=(-2, 3),
        textcoords="offset points",
        ha=side,
        va="bottom",
        color=PUBLISHED,
    )


def _columns(letters: list[int], inches: float) -> int:
    """Columns of a legend whose labels have so many letters; matplotlib fills one after the other."""
    for columns in range(min(MOST_COLUMNS, len(letters)), 1, -1):
        rows, longer = divmod(len(letters), columns)
        width, at = 0.0, 0
        for column in range(columns):
            end = at + rows + (1 if column < longer else 0)
            width, at = width + (max(letters[at:end]) + 8) / LETTERS_AN_INCH, end
        if width <= inches:
            return columns
    return 1


def plain_decades(axis: Any) -> None:
    """Numbers of a logarithmic axis as one writes them: 0.01; and 0.02, 0.05 where it spans hardly a decade."""
    from matplotlib.ticker import AutoLocator, FuncFormatter, LogLocator, NullFormatter

    class Labelled(LogLocator):
        """Where numbers stand: at least two of them on every axis, and no more than find room."""

        def __call__(self) -> Any:
            return self.tick_values(*axis.get_ylim())

        def tick_values(self, vmin: float, vmax: float) -> Any:
            room = min(6, max(2, round(LABELS_CLOSER * axis.yaxis.get_tick_space())))
            return log_ticks(vmin, vmax, room) or AutoLocator().tick_values(vmin, vmax)

    axis.yaxis.set_major_locator(Labelled())

    def written(value: float, _: int) -> str:
        low, high = axis.get_ylim()
        return plainly(value, 15, exponent=low < SMALLEST_PLAIN or high >= LARGEST_PLAIN)

    axis.yaxis.set_major_formatter(FuncFormatter(written))
    axis.yaxis.set_minor_formatter(NullFormatter())


def plainly(value: float, digits: int, *, exponent: bool = False) -> str:
    """A number in so many digits as one writes it, 0.00006; with an exponent, 6e-5, if that is asked for."""
    import numpy as np

    if exponent and value:
        mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(power)}"
    return str(np.format_float_positional(value, precision=digits, fractional=False, trim="-"))


def fine_grid(axis: Any) -> None:
    """Lines between the decades of a logarithmic axis with its final limits; as ticks they cost ten times that."""
    from matplotlib.collections import LineCollection
    from matplotlib.ticker import NullLocator

    axis.yaxis.set_minor_locator(NullLocator())
    low, high = axis.get_ylim()
    axis.set_ylim(low, high)
    if not 0.0 < low < high < MOST_DECADES * low:
        return
    decades = range(math.floor(math.log10(low)), math.floor(math.log10(high)) + 1)
    between = [v for k in decades for digit in range(2, 10) if low < (v := float(f"{digit}e{k}")) < high]
    lines = LineCollection([[(0.0, v), (1.0, v)] for v in between], transform=axis.get_yaxis_transform(), **FINE)
    axis.add_collection(lines, autolim=False)


def log_ticks(low: float, high: float, room: int) -> list[float]:
    """Round numbers of a logarithmic axis from low to high, two to `room`; none where it is too short for them."""
    if not 0.0 < low < high:
        return []
    first, last = math.floor(math.log10(low)), math.floor(math.log10(high))
    decades = [k for k in range(first, last + 1) if low <= 10.0**k]
    if len(decades) >= min(room, 3):
        apart = -(-len(decades) // room)
        even = [k for k in decades if k % apart == 0]
        return [float(f"1e{k}") for k in (even if len(even) > 1 else decades[::apart])]
    best: list[float] = []
    for digits in DIGITS:
        found = [v for k in range(first, last + 1) for d in digits if low <= (v := float(f"{d}e{k}")) <= high]
        if len(best) >= 2 and len(found) > room:
            break
        best = found if len(found) <= room or len(best) < 2 else best
    return best if len(best) >= 2 else []


def check_picture(path: Path) -> None:
    """Refuse a picture of another kind.

    Raises
    ------
    UsageError
        Naming the endings.
    """
    if path.suffix.lower() not in ENDINGS and not is_stream(path):
        raise UsageError(f"{path}: a picture ends in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}; got '{path.suffix}'")


def save(figures: list[Any], path: Path) -> None:
    """Write figures to one file: pages of a .pdf; of other kinds the first alone. The same figures, the same bytes."""
    kind = path.suffix.lower().lstrip(".") or "png"
    with styled(), replacing(path, ".png") as temporary:
        if kind == "pdf":
            from matplotlib.backends.backend_pdf import PdfPages

            with PdfPages(temporary, metadata={"Creator": "relnav", "CreationDate": None}) as pages:
                for figure in figures:
                    pages.savefig(figure)
            return
        if kind == "png":
            with _laid_out(figures[0]):
                figures[0].savefig(temporary, format=kind, dpi=DOTS_AN_INCH, pil_kwargs={"compress_level": 3})
        else:
            figures[0].savefig(temporary, format=kind, metadata={"Date": None} if kind == "svg" else {})


@contextmanager
def _laid_out(figure: Any) -> Iterator[None]:
    """The figure with its places found once; left to itself, matplotlib goes through a whole drawing for them first."""
    engine, dots = figure.get_layout_engine(), figure.dpi
    if engine is None:
        yield
        return
    figure.dpi = DOTS_AN_INCH
    engine.execute(figure)
    figure.set_layout_engine(None)
    try:
        yield
    finally:
        figure.set_layout_engine(engine)
        figure.dpi = dots
