"""`relnav filter` for a marker model: a track of position, attitude and docking port, and a summary."""

import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.errors import UsageError

if TYPE_CHECKING:
    from relnav.mission import VisionMission
    from relnav.navigation.pose_log import PoseSolution


def filter_markers(
    log: Path, mission: "VisionMission", out: Path | None, json_path: Path | None, *, quiet: bool, refused: str
) -> None:
    """Filter LOG, write what was asked for, print a summary; refused: an option that only beacon models have."""
    from relnav.files.atomic import replacing
    from relnav.files.marker_logs import filter_marker_log, write_track
    from relnav.files.tables import write_json

    if refused:
        raise UsageError(f"{refused} is for three-beacon models; {mission.name} has one filter, on its spots")
    solution = filter_marker_log(log, mission)
    figures = summary(solution)
    with ExitStack() as outputs:
        if out is not None:
            write_track(solution, outputs.enter_context(replacing(out)), {"log": log.name})
        if json_path is not None:
            write_json(figures, outputs.enter_context(replacing(json_path)))
        if not quiet:
            for line in lines(figures, log.name):
                click.echo(line)
            if out is not None:
                click.echo(f"track: {out}")


def summary(solution: "PoseSolution") -> dict[str, Any]:
    """Figures of a run as plain values; sigmas are those of the last epoch."""
    import numpy as np

    started = np.isfinite(solution.state[:, 0])
    consistency = solution.nis_consistency()
    sigma = np.sqrt(np.diag(solution.docking_covariance[-1]))
    return {
        "model": solution.model,
        "epochs": len(solution),
        "epochs_with_state": int(started.sum()),
        "epochs_with_rejected_spots": int(solution.refused.sum()),
        "epochs_unobservable": int((started & ~solution.observable).sum()),
        "epochs_ambiguous": int((solution.hypotheses > 1).sum()),
        "nis_per_dof": consistency.ratio,
        "nis": str(consistency),
        "port_m": [float(value) for value in solution.port_m[-1]],
        "sigma_port_m": [float(value) for value in sigma[:3]],
        "sigma_port_velocity_m_s": [float(value) for value in sigma[3:6]],
        "sigma_turn_deg": [math.degrees(value) for value in sigma[6:9]],
        "sigma_rate_deg_s": [math.degrees(value) for value in sigma[9:]],
    }


def lines(figures: dict[str, Any], name: str) -> list[str]:
    """The summary for a reader."""

    def triple(key: str, factor: float = 1.0, digits: str = ".4g") -> str:
        return ", ".join(format(factor * value, digits) for value in figures[key])

    out = [f"{name}: {figures['epochs']} epochs, model {figures['model']}, {figures['epochs_with_state']} with a state"]
    if figures["epochs_with_state"] == 0:
        return [*out, "no start: three markers on one image are needed, with a pose near the expected view"]
    out.append(f"port from port at the end, target axes: {triple('port_m', digits='.3f')} m")
    out.append(
        f"  1-sigma {triple('sigma_port_m', 1e3)} mm, {triple('sigma_port_velocity_m_s', 1e3)} mm/s, attitude "
        f"{triple('sigma_turn_deg')} deg, rate {triple('sigma_rate_deg_s')} deg/s"
    )
    out.append(f"{figures['nis']} (epochs used whole; {figures['epochs_with_rejected_spots']} had spots rejected)")
    if figures["epochs_ambiguous"]:
        out.append(f"{figures['epochs_ambiguous']} epochs with more than one possible pose: column 'hypotheses'")
    if figures["epochs_unobservable"]:
        out.append(
            f"{figures['epochs_unobservable']} epochs long after three markers were last seen at once: attitude hardly "
            "observed, column 'observable'"
        )
    return out
