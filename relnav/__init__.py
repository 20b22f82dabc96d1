"""Optical relative navigation for rendezvous and docking.

    import relnav
    model = relnav.load_model("three_beacon_psd")
    solution = relnav.filter_log("approach.csv", model)
    relnav.write(solution, "track.csv")

Each public name is one line of the block below. A type checker reads the block as it stands; at run time it is not run,
but read for where a name lives, so that a name is loaded when first used (PEP 562) and `import relnav` alone imports
neither numpy nor numba.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from relnav.accuracy.report import AccuracyReport as AccuracyReport
    from relnav.errors import InputError as InputError
    from relnav.errors import LogError as LogError
    from relnav.errors import ModelError as ModelError
    from relnav.errors import UsageError as UsageError
    from relnav.estimation.consistency import Consistency as Consistency
    from relnav.files.accuracy import measure_accuracy as measure_accuracy
    from relnav.files.campaign import campaign as campaign
    from relnav.files.filter_log import filter_log as filter_log
    from relnav.files.marker_logs import filter_marker_log as filter_marker_log
    from relnav.files.model_folders import list_models as list_models
    from relnav.files.models import load_model as load_model
    from relnav.files.models import load_published as load_published
    from relnav.files.scenarios import load_scenario as load_scenario
    from relnav.files.sun_calibration import load_sun_calibration as load_sun_calibration
    from relnav.files.tracks import write as write
    from relnav.mission import Model as Model
    from relnav.navigation.attitude.target_attitude import TargetAttitude as TargetAttitude
    from relnav.navigation.log import filter_epochs as filter_epochs
    from relnav.navigation.pose_log import filter_marker_epochs as filter_marker_epochs
    from relnav.navigation.record import FilterRecord as FilterRecord
    from relnav.navigation.record import Solution as Solution
    from relnav.navigation.relative_pose import PoseNavigator as PoseNavigator
    from relnav.navigation.relative_position import Navigator as Navigator
    from relnav.navigation.status import Alarm as Alarm
    from relnav.navigation.status import EpochStatus as EpochStatus
    from relnav.sensors import aps_sun as aps_sun
    from relnav.sensors import birefringent_sun as birefringent_sun
    from relnav.sensors import dual_field as dual_field
    from relnav.sensors import three_beacon as three_beacon
    from relnav.sensors import three_marker as three_marker
    from relnav.sensors.dual_field.star_spots import find_stars as find_stars
    from relnav.sensors.measurement import Measurement as Measurement
    from relnav.sensors.measurement import Status as Status
    from relnav.simulation.dispersed import simulate as simulate
    from relnav.simulation.dispersions import Scenario as Scenario
    from relnav.vehicle.navigator import VehicleNavigator as VehicleNavigator
else:  # hidden from type checkers: to them a name that is not above is an error

    def _homes():
        """Public name -> module, read from the block above."""
        import ast
        import pkgutil

        tree = ast.parse(pkgutil.get_data(__name__, "__init__.py"))
        block = next(node for node in tree.body if isinstance(node, ast.If))
        return {name.asname: line.module for line in block.body for name in line.names}

    _HOME = _homes()
    __all__ = sorted(_HOME)  # noqa: PLE0605  (type checkers take the block's `as`)

    def __getattr__(name):
        """Load a public name from its home (PEP 562)."""
        if name not in _HOME:
            raise AttributeError(f"module 'relnav' has no attribute {name!r}")
        home = __import__(_HOME[name], fromlist=[name])  # imports `name` too where it is a module
        value = globals()[name] = getattr(home, name)
        return value

    def __dir__():
        """Public names, loaded or not."""
        return sorted({*globals(), *_HOME})
