"""The validation report: every published figure with what was measured, every outside reference with its difference.

    python benchmarks/validation.py --out docs/validation.md        (some ten minutes of processor time)
    python benchmarks/validation.py --accuracy FOLDER               (with FOLDER/MODEL.json of `relnav accuracy --json`)
    python benchmarks/validation.py --only references               (the tests that hold an outside reference, a minute)

With `--out` the parts between the marks `<!-- validation: PART -->` and `<!-- validation: end -->` of a page are
written anew and the rest is left alone. Exit status 1 if a claim did not come out as expected or a
reference's test fails.
"""

import argparse
import json
import re
import sys
from pathlib import Path

import pytest

import relnav

ROOT = Path(__file__).parents[1]
MODELS = ("three_beacon_psd", "dual_field_star", "aps_sun", "three_marker_vision", "birefringent_sun")
AT_M = (6.5, 10.0)
"""Of a claim that is measured at many ranges, those that are shown: where the paper's figures meet, and the edge of the
range for which it states them. Of a filter the nearest bin: the farthest ends at 9.5 m, where tracks have settled."""


def claims(folder: Path | None) -> tuple[list[str], bool]:
    """Every claim of every model beside what was measured, and whether all came out as expected."""
    lines, ok = [], True
    for name in MODELS:
        given = None if folder is None else folder / f"{name}.json"
        if given is not None and given.is_file():
            report = json.loads(given.read_text())
        else:
            report = relnav.measure_accuracy(name).to_dict()
        ok &= report["ok"]
        lines += [f"### {relnav.load_model(name).title}", "", f"`relnav accuracy {name} --runs {report['runs']}`:", ""]
        lines += ["| claim | way | published | measured | found | expected |", "| --- | --- | --- | --- | --- | --- |"]
        for row in _shown(report["rows"]):
            where = row.get("condition") or (f"{row['range_m']:g} m" if row.get("range_m") else "")
            way = f"{row['method']}, {where}" if where else row["method"]
            figure = f"{row['published']:.4g} {row['unit']} ({row['statistic']})"
            found = "met" if row["met"] else "not met"
            cells = (row["quantity"], way, figure, f"{row['measured']:.3g}", found, row["expected"])
            lines.append("| " + " | ".join(cells) + " |")
        lines.append("")
    return lines, ok


def _shown(rows: list[dict]) -> list[dict]:
    """Rows that have a claim; of those at many ranges the ones nearest to each of AT_M."""
    claimed = [row for row in rows if row["published"] is not None and row["published"] == row["published"]]
    by_range = [row for row in claimed if "condition" not in row]
    nearest: dict[tuple[str, str, float], dict] = {}
    for row in by_range:
        for at_m in AT_M:
            key = row["quantity"], row["method"], at_m
            if key not in nearest or abs(row["range_m"] - at_m) < abs(nearest[key]["range_m"] - at_m):
                nearest[key] = row
    shown = {id(row) for row in nearest.values()}
    return [row for row in claimed if "condition" in row or id(row) in shown]


class Noted:
    """A pytest plugin: what tests hold against independent references (the fixture `outside`)."""

    def __init__(self) -> None:
        self.found: dict[tuple[str, str], tuple[float, float, str]] = {}
        self.skipped: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Called by pytest for every phase of every test."""
        if report.skipped:
            self.skipped.append(report.nodeid)
        if report.when != "call":
            return
        path = report.nodeid.split("::")[0]
        for name, value in report.user_properties:
            if name == "outside":
                reference, what, difference, bound = value
                before = self.found.get((reference, what), (0.0, 0.0, path))
                self.found[reference, what] = (max(difference, before[0]), bound, path)


def references() -> tuple[list[str], bool]:
    """Every outside reference with the largest difference found, its bound, and its test."""
    tests = [
        f"{path}::{name}"
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        for name in re.findall(r"^def (test_\w+)\([^)]*\boutside\b", path.read_text("utf-8"), re.MULTILINE)
    ]
    noted = Noted()
    code = pytest.main([*tests, "--rootdir", str(ROOT), "-n", "0", "-p", "no:cacheprovider"], plugins=[noted])
    lines = ["| reference | what | difference | bound | held by |", "| --- | --- | --- | --- | --- |"]
    for (reference, what), (difference, bound, path) in noted.found.items():
        lines.append(f"| {reference} | {what} | {difference:.2g} | {bound:.2g} | `{path}` |")
    return [*lines, ""], code == 0


def written(page: str, part: str, lines: list[str]) -> str:
    """The page with one of its parts written anew."""
    pattern = re.compile(rf"(<!-- validation: {part} -->\n).*?(<!-- validation: end -->)", re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"the page has no line <!-- validation: {part} -->")
    return pattern.sub(lambda found: f"{found[1]}\n" + "\n".join(lines) + found[2], page)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="Page to write into; otherwise it is printed.")
    parser.add_argument("--accuracy", type=Path, help="Folder of reports that are there already, MODEL.json.")
    parser.add_argument("--only", choices=["claims", "references"])
    given = parser.parse_args()
    parts = {"claims": lambda: claims(given.accuracy), "references": references}
    page, well = None if given.out is None else given.out.read_text("utf-8"), True
    for name, make in parts.items():
        if given.only in (None, name):
            lines, ok = make()
            well &= ok
            if page is None:
                print("\n".join(lines))
            else:
                page = written(page, name, lines)
    if page is not None:
        given.out.write_text(page, "utf-8")
    return 0 if well else 1


if __name__ == "__main__":
    sys.exit(main())
