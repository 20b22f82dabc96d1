"""A track as netCDF-4, which is HDF5: the arrays of `to_xarray`, units as CF has them; through xarray and h5netcdf."""

from pathlib import Path
from typing import Any

from relnav.files.atomic import replacing
from relnav.files.data_frames import to_xarray
from relnav.files.optional import require
from relnav.files.tables import framed


def check_netcdf(settings: dict[str, Any]) -> None:  # noqa: ARG001  (all formats take them)
    """Refuse what cannot be written, before there is a track.

    Raises
    ------
    UsageError
        If xarray, h5netcdf or h5py is missing; says how to install them.
    """
    for package in ("xarray", "h5netcdf", "h5py"):  # h5netcdf 1.8 no longer brings h5py
        require(package, "netcdf", f"A netCDF or HDF5 file needs {package}")


def write_netcdf(solution: Any, path: Path, settings: dict[str, Any]) -> None:
    """Write it; raises as `check_netcdf`."""
    data = to_xarray(solution, framed(solution, settings))
    with replacing(path) as temporary:
        data.to_netcdf(temporary, engine="h5netcdf")
