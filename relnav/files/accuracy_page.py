"""The page of an accuracy report: every measured figure beside its claim, as `relnav accuracy --json` wrote them."""

import math
from pathlib import Path
from typing import Any

from relnav.errors import LogError
from relnav.files.report_page import Markup, numbered, paragraph, section, table, tile, write_page
from relnav.files.tables import read_json


def read_report(path: Path) -> dict[str, Any]:
    """The JSON object of an accuracy report.

    Raises
    ------
    LogError
        For what is none.
    """
    report = read_json(path, "an accuracy report")
    rows = report.get("rows") if isinstance(report, dict) else None
    good = isinstance(rows, list) and all(isinstance(r, dict) and {"quantity", "measured"} <= set(r) for r in rows)
    if not good or "model" not in report:
        raise LogError(f"{path}: what `relnav accuracy --json` writes is expected: an object with 'model' and 'rows'")
    return dict(report)


def write_accuracy_page(report: dict[str, Any], path: Path) -> None:
    """Write the page of a report."""
    rows = report["rows"]
    compared = [row for row in rows if _number(row.get("published")) is not None]
    kept = [row for row in compared if row.get("met") == (row.get("expected") == "met")]
    verdict = "good" if report.get("ok") else "bad"
    tiles = [
        tile("every row as expected", "yes" if report.get("ok") else "NO", "by the model's published.toml", verdict),
        tile("figures beside a claim", str(len(compared)), f"{len(kept)} came out as expected"),
        tile("runs", str(report.get("runs", "")), f"seed {report.get('seed', '')}"),
    ]
    parts = [f'<div class="tiles">{"".join(tiles)}</div>']
    for method in dict.fromkeys(str(row.get("method", "")) for row in rows):
        own = [row for row in rows if str(row.get("method", "")) == method]
        parts.append(section(method or "Figures", *_figures(own)))
    if isinstance(consistency := report.get("consistency"), list):
        parts.append(section("Consistency of the covariance", table(_HONEST, map(_honest, consistency), (1, 2, 3))))
    if notes := report.get("notes"):
        parts.append(section("Notes", table(("note",), [(note,) for note in notes])))
    lead = "Measured against truth that shares nothing with the filter, beside the figures of the paper."
    write_page(path, f"Accuracy of {report['model']}", lead, "".join(parts))


_HEAD = ("quantity", "where", "published", "measured", "measured / published", "came out")
_HONEST = ("way", "mean NEES", "share in its 95 % band", "NIS per dof", "consistent", "expected", "why")


def _number(value: Any) -> float | None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if good else None


def figure(value: Any, unit: object = "") -> str:
    """A number with its unit; a dash for what is none."""
    number = _number(value)
    return "-" if number is None else f"{number:.4g} {unit}".rstrip()


def _figures(rows: list[dict[str, Any]]) -> list[str]:
    """A table of figures; what many rows share, statistics and reasons, stands once, by its number."""
    statistics, reasons = (
        list(dict.fromkeys(str(row[key]) for row in rows if row.get(key))) for key in ("statistic", "reason")
    )
    head: tuple[str, ...] = _HEAD
    cells: list[tuple[object, ...]] = [_cells(row, reasons) for row in rows]
    if len(statistics) > 1:
        head = (*_HEAD[:5], "statistic", _HEAD[5])
        cells = [(*c[:5], row.get("statistic", ""), c[5]) for c, row in zip(cells, rows, strict=True)]
    parts = [paragraph(statistics[0])] if len(statistics) == 1 else []
    parts.append(table(head, cells, (2, 3), classes="scroll short"))
    return [*parts, numbered(reasons)] if reasons else parts


def _cells(row: dict[str, Any], reasons: list[str]) -> tuple[object, ...]:
    published, measured = _number(row.get("published")), _number(row["measured"])
    ratio: object = "for information"
    if published and measured is not None:
        share = measured / published
        width = min(100.0, 50.0 * share)
        ratio = Markup(f'<span class="track"><span class="bar" style="width:{width:.1f}%"></span></span> {share:.3g}')
    where = row.get("condition") or (f"{row['range_m']:g} m" if _number(row.get("range_m")) is not None else "")
    came = ("met" if row.get("met") else "not met") + f", expected {row.get('expected', '')}"
    why = f" ({reasons.index(str(row['reason'])) + 1})" if row.get("reason") else ""
    unit = row.get("unit", "")
    return (
        row["quantity"],
        where,
        figure(published, unit),
        figure(measured, unit),
        ratio,
        (came if published is not None else "") + why,
    )


def _honest(row: Any) -> tuple[object, ...]:
    entry = row if isinstance(row, dict) else {}
    return (
        entry.get("method", ""),
        figure(entry.get("nees_mean")),
        figure(entry.get("nees_inside_95")),
        figure(entry.get("nis_per_dof")),
        entry.get("met", ""),
        entry.get("expected", ""),
        entry.get("reason", ""),
    )
