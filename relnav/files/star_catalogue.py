"""The shipped star catalogue: Hipparcos-2 to Hp 8.0, as made by `tools/build_star_catalogue.py`."""

from functools import lru_cache

import numpy as np

from relnav.errors import InputError
from relnav.files.model_folders import models_root
from relnav.sensors.dual_field.catalogue import StarCatalogue

NAME = "star_catalogue/hip2_hp80.npz"


@lru_cache(maxsize=1)
def load_star_catalogue() -> StarCatalogue:
    """The catalogue, read once.

    Raises
    ------
    InputError
        If the file is missing or damaged.
    """
    path = models_root() / NAME
    try:
        with np.load(path) as table:
            columns = {name: table[name] for name in table.files}
        for angle in ("ra", "dec"):
            columns[f"{angle}_rad"] = columns.pop(f"{angle}_1e10_rad") / 1e10
        for values in columns.values():
            values.setflags(write=False)
        return StarCatalogue(**columns)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: the star catalogue cannot be read ({error}); install relnav again") from error


def mission_extras() -> dict[str, StarCatalogue]:
    """What a star sensor's mission holds beside its model file."""
    return {"catalogue": load_star_catalogue()}
