"""Model folders: which there are, what they are called, and which one a name stands for; without reading their values.

Apart from `files.models`, because a list of titles is wanted at once and values need numpy and pydantic.
"""

import difflib
import os
import re
import tomllib
from pathlib import Path

from relnav.errors import UnknownModelError
from relnav.files.paths import path_of
from relnav.files.wording import shown


def models_root() -> Path:
    """Folder of the shipped models: inside the package when installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "models"
    return inside if inside.is_dir() else package.parent / "models"


def list_models() -> list[str]:
    """Names of the shipped models, sorted."""
    return sorted(folder.parent.name for folder in models_root().glob("*/model.toml"))


def find_model(name_or_path: str | os.PathLike[str]) -> Path:
    """The `model.toml` that a shipped name, a folder or a file stands for.

    Raises
    ------
    UnknownModelError
        If there is none; a close match is suggested.
    """
    path = path_of(name_or_path, "a model's name or path")
    name = str(path)
    shipped = models_root() / name / "model.toml"
    if name in list_models():
        return shipped
    if path.is_dir() and (path / "model.toml").is_file():
        return path / "model.toml"
    if path.is_file():
        return path
    near = difflib.get_close_matches(name, list_models(), n=1)
    hint = f"did you mean '{near[0]}'?" if near else f"shipped models are {', '.join(list_models())}"
    raise UnknownModelError(f"no model '{name}', neither shipped nor a folder or file; {hint}")


def sensor_type(name_or_path: str | os.PathLike[str]) -> str:
    """What a model file says, in its first 200,000 characters, that it is of; empty where it does not say it.

    Nothing else of the file is looked at: whoever loads it refuses what is wrong with it.
    """
    try:
        path = find_model(name_or_path)
        if not path.is_file():
            return ""
        with path.open(encoding="utf-8", errors="replace") as file:
            said = re.search(r'^\s*sensor_type\s*=\s*"(\w+)"', file.read(200_000), re.MULTILINE)
    except (UnknownModelError, OSError, ValueError):
        return ""
    return said[1] if said else ""


def shipped_titles() -> dict[str, str]:
    """Title of every shipped model by its name."""
    files = {name: (models_root() / name / "model.toml").read_text(encoding="utf-8") for name in list_models()}
    return {name: shown(tomllib.loads(text).get("title", name)) for name, text in files.items()}
