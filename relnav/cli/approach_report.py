"""The accuracy report of a relative navigation mission as lines of text."""

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from relnav.accuracy.claims import ClaimsReport
    from relnav.accuracy.report import AccuracyReport


def report_lines(report: "AccuracyReport") -> list[str]:
    """The report for a reader."""
    lines = [f"model {report.model}, {report.runs} approaches, seed {report.seed}; errors against truth, rms"]
    method = ""
    for row in report.rows:
        if row.method != method:
            method = row.method
            lines.append(method)
            lines.append("    range   quantity     published      rms      bias   1-sigma   99.73 %  within 1s / 3s")
        verdict = ("met" if row.met else "not met") + ("" if row.as_expected else f", EXPECTED {row.expected}")
        within = f"{row.coverage_1:.3f} / {row.coverage_3:.4f}"
        lines.append(
            f"  {row.range_m:5.2f} m   {row.quantity:<9} {row.published:8g} {row.unit:<3} {row.measured:9.5f} "
            f"{row.bias:9.5f} {row.sigma:9.5f} {row.three_sigma:9.5f}  {within}  {verdict}"
        )
    if any("spots" in row.method for row in report.rows):
        left_out = math.degrees(report.attitude_sigma_rad)
        lines.append(
            f"spots filter: of noise alone, its attitude taken as exact; the {left_out:g} deg of attitude.sigma_deg, "
            "which a track contains in azimuth and elevation, are left out"
        )
    lines.append("consistency, state NEES over runs, epoch by epoch (consistent: 95 % of epochs in the 95 % band)")
    for entry in report.consistency:
        good = "not overconfident" if entry.one_sided or entry.lasting else "consistent"
        verdict = good if entry.consistent else "NOT consistent"
        if not entry.as_expected:
            verdict += ", NOT EXPECTED"
        nees = entry.nees
        interval = "" if entry.nis.withheld else f" of [{entry.nis.lower:.4f}, {entry.nis.upper:.4f}]"
        lines.append(
            f"  {entry.method:<44} mean {nees.mean:7.2f} of {nees.dof}, inside 95 %: {nees.inside_95:.3f}, "
            f"outside 99.99 %: {nees.outside_9999:.4f}; NIS/dof {entry.nis.ratio:.4f}{interval}  {verdict}"
        )
    lines.extend(f"    {row.method}: {row.reason}" for row in report.consistency if not row.expected_consistent)
    lines.append("settled filter on the docking axis, 1-sigma: Riccati equation | the filter itself after a long hold")
    for place in report.settled:
        riccati = (place.sigma_range_m, math.degrees(place.sigma_azimuth_rad), math.degrees(place.sigma_elevation_rad))
        itself = (
            place.reached_range_m,
            math.degrees(place.reached_azimuth_rad),
            math.degrees(place.reached_elevation_rad),
        )
        pairs = [f"{one:.5f} | {two:.5f}" for one, two in zip(riccati, itself, strict=True)]
        worst = place.observability[-1] / place.observability[0]
        lines.append(
            f"  {place.method:<6} {place.range_m:5.2f} m   range {pairs[0]} m, azimuth {pairs[1]} deg, "
            f"elevation {pairs[2]} deg; observability {worst:.1e}"
        )
    lines.append(closing_line(report))
    return lines


def compared(report: "AccuracyReport | ClaimsReport") -> bool:
    """Whether any figure stands beside a published one."""
    return any(not math.isnan(row.published) for row in report.rows)


def closing_line(report: "AccuracyReport | ClaimsReport") -> str:
    """The last line: whether the figures came out as expected."""
    if not report.ok:
        return "SOME ROWS DID NOT COME OUT AS EXPECTED"
    if not compared(report):
        return "NOTHING TO COMPARE WITH: no published.toml stands beside this model, or it claims nothing of this"
    return "every row came out as expected"
