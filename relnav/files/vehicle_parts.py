"""The sensors of a vehicle file: each names a model, which is loaded from the shipped ones or beside the file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from relnav.errors import ModelError, UnknownModelError
from relnav.files.model_folders import list_models, sensor_type
from relnav.files.toml_values import Problems


def sensor_models(values: Mapping[str, Any], path: Path, problems: Problems) -> dict[str, Any]:
    """Models of the sensors of a vehicle, by the sensors' names, as its field `models`."""
    from relnav.files.models import load_model  # which asks for this file

    found: dict[str, Any] = {}
    for name, mounted in values.get("sensor", {}).items():
        key, beside = f"sensor.{name}.model", path.parent / mounted.model
        place = mounted.model if mounted.model in list_models() else beside
        if sensor_type(place) == "vehicle":
            problems.add(key, f"a sensor's model is expected; '{mounted.model}' is a vehicle's")
            continue
        try:
            found[name] = load_model(place)
        except UnknownModelError:
            problems.add(
                key,
                f"no model '{mounted.model}', neither shipped ({', '.join(list_models())}) nor a file or folder beside "
                "this one",
            )
        except ModelError as error:
            problems.add(key, f"its model cannot be used: {error}")
    return {"models": found}
