"""A detector's calibration as a file: written by `relnav calibrate psd`, named by a model file's [calibration]."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from relnav.errors import ModelError
from relnav.files.atomic import replacing
from relnav.files.toml_values import Problems, build, read_toml
from relnav.files.wording import shown
from relnav.sensors.three_beacon.calibration import Calibration, exponents

ANYWHERE = "RELNAV_CALIBRATION_ANYWHERE"
"""Environment variable: 1 lets a model name a calibration outside its own folder."""

if TYPE_CHECKING:
    from relnav.sensors.three_beacon.calibrate import CalibrationReport


def write_calibration(report: "CalibrationReport", path: Path, grid: str) -> None:
    """Write a calibration (TOML), lengths in micrometres."""
    from relnav.files.tables import relnav_version

    c = report.calibration

    def um(values: tuple[float, ...]) -> str:
        return "[" + ", ".join(repr(value * 1e6) for value in values) + "]"

    names = ["1", *(f"u^{i} v^{j}" for i, j in exponents(c.order)[1:])]
    lines = [
        f"# Detector calibration by relnav {relnav_version()} from {grid}: {c.points} points.",
        "# true = measured + sum of c_ij u^i v^j, u and v = (measured - center) / half_width, held at +-1 outside.",
        f"# Coefficients in the order {', '.join(names)}.",
        "",
        "[calibration]",
        f"order = {c.order}",
        f"center_um = {um(c.center_m)}",
        f"half_width_um = {um(c.half_width_m)}",
        f"correction_x_um = {um(c.correction_x_m)}",
        f"correction_y_um = {um(c.correction_y_m)}",
        f"residual_sigma_um = {c.residual_sigma_m * 1e6!r}",
        f"rim_slope = {c.rim_slope!r}",
        f"points = {c.points}",
        f"noise_sigma_um = {c.noise_sigma_m * 1e6!r}",
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_calibration(path: Path) -> Calibration:
    """Read a calibration.

    Raises
    ------
    ModelError
        If the file cannot be read, or what is wrong with it.
    """
    table, problems = read_toml(path)
    for name in set(table) - {"calibration"}:
        problems.add(name, "unknown section; a calibration file holds [calibration]")
    if "calibration" not in table:
        problems.add("calibration", "a section [calibration] is expected, as `relnav calibrate psd` writes it")
        problems.raise_if_any()
    calibration = build(Calibration, table["calibration"], "calibration", problems, None)
    problems.raise_if_any()
    assert isinstance(calibration, Calibration)
    return calibration


def named_calibration(section: Any, model: Path, problems: Problems, provenance: dict[str, str]) -> Calibration | None:
    """The calibration that a section `[calibration]` names by `file`, in the model's folder unless ANYWHERE allows."""
    entry = section.get("file") if isinstance(section, dict) else None
    if isinstance(entry, dict):
        provenance["calibration.file"] = f"{entry.get('source')}: {entry.get('why')}"
        entry = entry.get("value")
    if not isinstance(section, dict) or set(section) != {"file"} or not isinstance(entry, str):
        problems.add(
            "calibration",
            f'file = "..." is expected (from `relnav calibrate psd`), and no other key; got {shown(repr(section), 80)}',
        )
        return None
    provenance.setdefault("calibration.file", "unstated")
    folder = model.parent.resolve()
    try:
        path = (folder / entry).resolve()
    except (RuntimeError, ValueError, OSError):  # links in a circle, a null character
        path = folder
    if not path.is_relative_to(folder) and os.environ.get(ANYWHERE) != "1":
        problems.add(
            "calibration.file",
            f"'{entry}' lies outside the model's folder; put it beside the model, or allow it with {ANYWHERE}=1 in the "
            "environment if you trust the model",
        )
        return None
    if path.exists() and not path.is_file():
        problems.add("calibration.file", f"'{entry}' is no regular file")
        return None
    try:
        return read_calibration(model.parent / entry)
    except ModelError as error:
        problems.add("calibration.file", str(error))
        return None
