"""Packages that not everybody needs: imported when asked for, and where they are missing a line that installs them."""

from importlib import import_module
from typing import Any

from relnav.errors import UsageError


def require(package: str, extra: str, need: str, instead: str = "") -> Any:
    """Import an optional package.

    Parameters
    ----------
    package : str
        Module to import.
    extra : str
        Of relnav, that installs it.
    need : str
        Begin of the sentence, "Parquet files need pyarrow".
    instead : str
        Its end, if there is another way.

    Raises
    ------
    UsageError
        With the line that installs it.
    """
    try:
        return import_module(package)
    except ImportError as error:
        raise UsageError(f"{need}: pip install 'relnav[{extra}]'{instead}") from error
