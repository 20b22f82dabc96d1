"""`relnav filter` for a marker model: a track of position, attitude and docking port, and a summary."""

import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from relnav.cli.epoch_bar import epoch_bar
from relnav.cli.printing import say
from relnav.errors import UsageError
from relnav.navigation.lasting_words import left_out, left_out_line, marker_words
from relnav.navigation.status import Alarm

if TYPE_CHECKING:
    from relnav.arrays import Vector
    from relnav.cli.picture import Picture
    from relnav.cli.track_output import TrackOutput
    from relnav.mission import VisionMission
    from relnav.navigation.pose_record import PoseSolution


def filter_markers(
    log: Path,
    mission: "VisionMission",
    track: "TrackOutput",
    json_path: Path | None,
    picture: "Picture",
    *,
    quiet: bool,
    smooth: bool,
    engine: str,
    refused: str,
) -> int:
    """Filter LOG, write what was asked for, print a summary; refused: an option that only beacon models have."""
    from relnav.cli import NOT_STARTED
    from relnav.files.atomic import Outputs
    from relnav.files.filter_file import engine_words
    from relnav.files.marker_logs import is_controlled, marker_log, marker_solutions, write_track
    from relnav.files.tables import write_json

    if refused:
        raise UsageError(f"{refused} is for three-beacon models; {mission.name} has one filter, on its spots")
    summary = Summary(mission)
    picture.of(mission)
    opened = marker_log(log, mission)
    summary.controlled = is_controlled(opened)
    filtered = marker_solutions(opened, mission, smooth=smooth, engine=engine)
    parts = track.passing(picture.passing(summary.passing(filtered)))
    with Outputs() as outputs, epoch_bar(log, quiet=quiet) as progress:
        parts = parts if progress is None else counted(parts, progress)
        table = track.table(outputs)
        if table is not None:
            stated = {"log": log.name} | ({"smoothed": "yes"} if smooth else {}) | engine_words(engine)
            stated |= marker_words(mission)
            write_track(parts, mission.name, table, stated, turning=track.turning(mission))
        for _ in parts:
            pass
        track.finish(outputs, mission)
        picture.draw(outputs, log)
        figures = summary.figures()
        if json_path is not None:
            write_json(figures, outputs.path(json_path))
    if not quiet:
        say([*lines(figures, log.name), *picture.said(track.written)], track.path, picture.path, json_path)
    return 0 if figures["epochs_with_state"] else NOT_STARTED


def counted(parts: "Iterable[PoseSolution]", progress: Callable[[int], None]) -> "Iterator[PoseSolution]":
    """The parts, their epochs told as they pass."""
    for part in parts:
        progress(len(part))
        yield part


REFUSED_SHARE = 0.02
"""Of a log's images: with more refused in part, what the model does not know of is looked for."""
_ALARMS = {str(one.name).lower(): one for one in Alarm if one is not Alarm.UNWATCHED}
_MONITORS = {name: one for name, one in _ALARMS.items() if one not in (Alarm.EXCHANGED, Alarm.OUT_OF_VIEW)}


class Summary:
    """Figures of a run, gathered while its parts pass; sigmas are those of the last epoch."""

    def __init__(self, mission: "VisionMission") -> None:
        """Take the model."""
        from relnav.files.gathered import Gathered

        self._parts = Gathered(self._take)
        self._mission, self._nis, self._dof, self._attitude = mission, 0.0, 0, ""
        self._left_out = left_out(mission)
        self.controlled = True
        self._notes: tuple[str, ...] = ()
        self._last: tuple[Vector, Vector] | None = None
        self._smoothed = False
        names = (
            "epochs",
            "with_state",
            "with_rejected_spots",
            "unobservable",
            "ambiguous",
            "too_late",
            "alarmed",
            *_ALARMS,
        )
        self._counts = dict.fromkeys(names, 0)

    def passing(self, parts: "Iterable[PoseSolution]") -> "Iterator[PoseSolution]":
        """The parts, each taken in when it has passed."""
        import numpy as np

        from relnav.files.attitude_reading import reading_that_looks, stepped
        from relnav.files.filter_file import spacing_note
        from relnav.files.rounded_spots import rounded

        looked = False
        for part in parts:
            if not looked:
                self._attitude = reading_that_looks(part.epochs["chaser"][0], self._mission.dcm_chaser_from_lvlh)
                turned = np.diff(part.epochs["chaser"], axis=0)
                angles = np.sqrt(0.5 * (turned**2).sum(axis=(1, 2)))  # of small turns of matrices
                camera, own = self._mission.camera, self._mission.chaser.attitude_noise_rad
                spot = camera.spot_noise_px / max(camera.focal_length_px)
                seen = () if part.spots_px is None else rounded(part.spots_px, camera.spot_noise_px, "px")
                self._notes = (*spacing_note(part.t_s), *seen, *stepped(angles, own, spot))
                looked = True
            yield part
            self._parts.take(part)

    def _take(self, part: "PoseSolution") -> None:
        import numpy as np

        from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

        started = np.isfinite(part.state[:, 0])
        refused = part.refused
        whole = (part.dof > 0) & ~refused
        flags = {
            "epochs": np.ones(len(part), dtype=bool),
            "with_state": started,
            "with_rejected_spots": refused,
            "unobservable": started & ~part.observable,
            "ambiguous": started & (part.ambiguity < AMBIGUITY_LIMIT),
            "too_late": part.too_late,
            "alarmed": part.alarm != 0,
        } | {name: part.alarm & int(code) > 0 for name, code in _ALARMS.items()}
        for name, flag in flags.items():
            self._counts[name] += int(flag.sum())
        self._nis += float(part.nis[whole].sum())
        self._dof += int(part.dof[whole].sum())
        self._smoothed = part.smoothed
        self._last = part.port_m[-1], np.sqrt(np.diag(part.docking_covariance[-1]))

    def figures(self) -> dict[str, Any]:
        """The figures as plain values; NIS is that of the epochs used whole."""
        from relnav.estimation.consistency import consistency_of_sum

        self._parts.settle()
        lasting = bool(marker_words(self._mission))
        consistency = consistency_of_sum("NIS", self._nis, self._dof, lasting=lasting)
        assert self._last is not None
        port, sigma = self._last
        counts = {name if name == "epochs" else f"epochs_{name}": count for name, count in self._counts.items()}
        return {
            "model": self._mission.name,
            "smoothed": self._smoothed,
            "left_out": self._left_out,
            **counts,
            "nis_per_dof": consistency.ratio,
            "nis": str(consistency),
            "attitude_hint": self._attitude,
            "notes": [*self._notes, *self._control_hint()],
            "port_m": [float(value) for value in port],
            "sigma_port_m": [float(value) for value in sigma[:3]],
            "sigma_port_velocity_m_s": [float(value) for value in sigma[3:6]],
            "sigma_turn_deg": [math.degrees(value) for value in sigma[6:9]],
            "sigma_rate_deg_s": [math.degrees(value) for value in sigma[9:]],
        }

    def _control_hint(self) -> "Iterator[str]":
        """What a log without control columns may lack, if many images were refused."""
        if not self.controlled and self._counts["with_rejected_spots"] > REFUSED_SHARE * self._counts["epochs"]:
            yield "the log has no control columns (accel_x_m_s2, ...): if the chaser thrusts, add them"


def lines(figures: dict[str, Any], name: str) -> list[str]:
    """The summary for a reader."""

    def triple(key: str, factor: float = 1.0, digits: str = ".4g") -> str:
        return ", ".join(format(factor * value, digits) for value in figures[key])

    model = figures["model"] + (", smoothed" if figures["smoothed"] else "")
    out = [f"{name}: {figures['epochs']} epochs, model {model}, {figures['epochs_with_state']} with a state"]
    if figures["left_out"]:
        out.append(left_out_line(figures["left_out"]))
    out += figures["notes"]
    if figures["attitude_hint"]:
        out.append(figures["attitude_hint"])
    if figures["epochs_with_state"] == 0:
        seen = f" ({figures['epochs_out_of_view']} images had none)" if figures["epochs_out_of_view"] else ""
        needed = "two images in a row must show three markers or more, as one pose near the expected view explains them"
        return [*out, f"no start: {needed}{seen}; spots that fit no pose: markers exchanged, displaced, more noise?"]
    out.append(f"port from port at the end, target axes: {triple('port_m', digits='.3f')} m")
    out.append(
        f"  1-sigma {triple('sigma_port_m', 1e3)} mm, {triple('sigma_port_velocity_m_s', 1e3)} mm/s, attitude "
        f"{triple('sigma_turn_deg')} deg, rate {triple('sigma_rate_deg_s')} deg/s"
    )
    out.append(f"{figures['nis']} (epochs used whole; {figures['epochs_with_rejected_spots']} had spots rejected)")
    if figures["epochs_ambiguous"]:
        out.append(
            f"{figures['epochs_ambiguous']} epochs with an ambiguous pose, not to be used: column 'ambiguity' is below "
            "18.4 there"
        )
    if figures["epochs_unobservable"]:
        out.append(
            f"{figures['epochs_unobservable']} epochs long after three markers off one line were last used: attitude "
            "hardly observed, column 'observable'"
        )
    said = [f"{one.name} {figures[f'epochs_{name}']}" for name, one in _MONITORS.items() if figures[f"epochs_{name}"]]
    if said:
        alarmed = f"ALARM in {figures['epochs_alarmed']} epochs (epochs: {', '.join(said)})"
        out.append(f"{alarmed}: do not use the states there")
    if figures["epochs_exchanged"]:
        seen = figures["epochs_exchanged"]
        out.append(f"{seen} images of markers that look exchanged, not used: 'alarm' {int(Alarm.EXCHANGED)}")
    if figures["epochs_out_of_view"]:
        out.append(
            f"{figures['epochs_out_of_view']} images whose poses all contradict the model's [view], no start: "
            f"'alarm' {int(Alarm.OUT_OF_VIEW)}"
        )
    if figures["epochs_too_late"]:
        out.append(f"{figures['epochs_too_late']} images later than the model's longest_delay_s, not used: 'too_late'")
    return out
