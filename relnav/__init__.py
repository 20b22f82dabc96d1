"""Optical relative navigation for rendezvous and docking.

    import relnav
    model = relnav.load_model("three_beacon_psd")
    solution = relnav.filter_log("approach.csv", model)
    relnav.write(solution, "track.csv")

Public names are loaded when first used: `import relnav` alone imports neither numpy nor numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from relnav.accuracy.report import AccuracyReport
    from relnav.errors import InputError, LogError, ModelError, UsageError
    from relnav.estimation.consistency import Consistency
    from relnav.files.accuracy import measure_accuracy
    from relnav.files.filter_log import filter_log
    from relnav.files.marker_logs import filter_marker_log
    from relnav.files.models import list_models, load_model, load_published
    from relnav.files.sun_calibration import load_sun_calibration
    from relnav.files.tables import write
    from relnav.mission import Model
    from relnav.navigation.log import filter_epochs
    from relnav.navigation.record import FilterRecord, Solution
    from relnav.navigation.relative_pose import PoseNavigator
    from relnav.navigation.relative_position import Navigator
    from relnav.navigation.status import EpochStatus
    from relnav.navigation.target_attitude import TargetAttitude
    from relnav.sensors import aps_sun, birefringent_sun, dual_field, three_beacon, three_marker
    from relnav.sensors.measurement import Measurement, Status

_HOME = {
    "AccuracyReport": "relnav.accuracy.report",
    "measure_accuracy": "relnav.files.accuracy",
    "InputError": "relnav.errors",
    "LogError": "relnav.errors",
    "ModelError": "relnav.errors",
    "UsageError": "relnav.errors",
    "Consistency": "relnav.estimation.consistency",
    "filter_log": "relnav.files.filter_log",
    "filter_marker_log": "relnav.files.marker_logs",
    "list_models": "relnav.files.models",
    "load_model": "relnav.files.models",
    "load_published": "relnav.files.models",
    "load_sun_calibration": "relnav.files.sun_calibration",
    "write": "relnav.files.tables",
    "Model": "relnav.mission",
    "FilterRecord": "relnav.navigation.record",
    "Solution": "relnav.navigation.record",
    "Navigator": "relnav.navigation.relative_position",
    "PoseNavigator": "relnav.navigation.relative_pose",
    "TargetAttitude": "relnav.navigation.target_attitude",
    "filter_epochs": "relnav.navigation.log",
    "EpochStatus": "relnav.navigation.status",
    "birefringent_sun": "relnav.sensors.birefringent_sun",
    "aps_sun": "relnav.sensors.aps_sun",
    "dual_field": "relnav.sensors.dual_field",
    "three_beacon": "relnav.sensors.three_beacon",
    "three_marker": "relnav.sensors.three_marker",
    "Measurement": "relnav.sensors.measurement",
    "Status": "relnav.sensors.measurement",
}

_MODULES = ("aps_sun", "birefringent_sun", "dual_field", "three_beacon", "three_marker")

__all__ = [
    "AccuracyReport",
    "Consistency",
    "EpochStatus",
    "FilterRecord",
    "InputError",
    "LogError",
    "Measurement",
    "Model",
    "ModelError",
    "Navigator",
    "PoseNavigator",
    "Solution",
    "Status",
    "TargetAttitude",
    "UsageError",
    "aps_sun",
    "birefringent_sun",
    "dual_field",
    "filter_epochs",
    "filter_log",
    "filter_marker_log",
    "list_models",
    "load_model",
    "load_published",
    "load_sun_calibration",
    "measure_accuracy",
    "three_beacon",
    "three_marker",
    "write",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its home (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module 'relnav' has no attribute {name!r}")
    module = import_module(_HOME[name])
    value = module if name in _MODULES else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, loaded or not."""
    return sorted({*globals(), *_HOME})
