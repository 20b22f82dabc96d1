"""What a reader may turn a solution into: pictures, tables of other libraries, other frames.

The room `files` does the work, and lies above this one: it is looked up by name when it is asked for, so that nothing
here imports it and a solution stays plain values.
"""

from importlib import import_module
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from relnav.dynamics.in_frame import FramedTrack, in_frame

if TYPE_CHECKING:
    import os


class Presented:
    """Methods that every solution has."""

    def __repr__(self) -> str:
        """A few lines for the console."""
        solution: Any = self
        known = np.flatnonzero(np.isfinite(solution.state[:, 0]))
        method = ", ".join(
            [*([solution.method] if hasattr(solution, "method") else []), *["smoothed"] * solution.smoothed]
        )
        head = f"{type(self).__name__} of {solution.model}{f' ({method})' if method else ''}: {len(solution)} epochs"
        if not len(solution):
            return head
        lines = [f"{head}, {solution.t_s[0]:.9g} s to {solution.t_s[-1]:.9g} s, {len(known)} with a state"]
        if len(known):
            last = int(known[-1])
            x, y, z = solution.state[last, :3]
            lines.append(f"  at {solution.t_s[last]:.9g} s: position {x:.4f}, {y:.4f}, {z:.4f} m (lvlh_ccsds)")
            lines.append(f"  {solution.nis_consistency()} (whole epochs)")
        lines.append("  .plot()  .in_frame('rsw')  .to_dataframe()  .to_xarray()  relnav.write(solution, path)")
        return "\n".join(fill(line, 80, subsequent_indent="    ") for line in lines)

    def plot(
        self, path: "str | os.PathLike[str] | None" = None, *, model: Any = None, corridor_deg: float = 10.0
    ) -> Any:
        """Draw the run: approach, state with 3-sigma envelopes, measurements with gates and bounds.

        Parameters
        ----------
        path : str or path, optional
            Where to write it, .png, .pdf or .svg; nowhere if left out.
        model : Model or VisionMission, optional
            What it was filtered with, for gates and published figures; if left out, the shipped one of that name.
        corridor_deg : float
            Half angle of the approach corridor that is drawn.

        Returns
        -------
        matplotlib.figure.Figure
            A notebook shows it; `savefig` writes it.

        Raises
        ------
        UsageError
            For another ending.
        """
        return _above("relnav.files.track_picture:plot_solution")(self, path, model, corridor_deg)

    def in_frame(
        self, frame: str, *, orientation_deg: tuple[float, float, float] | None = None, model: Any = None
    ) -> FramedTrack:
        """States, attitudes of the target and covariances turned into another frame.

        Parameters
        ----------
        frame : {"lvlh_ccsds", "rsw", "dock", "eci_relative", "eci"}
            What each is: `relnav.dynamics.in_frame.FRAMES`. `rsw` is RTN, RIC, Hill.
        orientation_deg : (3,), optional
            Inertial frames: inclination, right ascension of the ascending node, argument of perigee of the target's
            orbit, whose shape and phase are the model's. The orbit is taken as exact and two-body.
        model : Model or VisionMission, optional
            What it was filtered with, if that is no shipped model.

        Returns
        -------
        FramedTrack
            `t_s`, `state` (n, 6), `covariance` (n, 6, 6), `frame`, `metadata`, `to_dataframe()`, `to_xarray()`; of
            markers `covariance` (n, 12, 12), `dcm_frame_from_target`, `q_frame_from_target` and `rate_rad_s` too.

        Raises
        ------
        UsageError
            For an unknown frame, or one that needs what was not given.
        """
        mission = _above("relnav.files.models:mission_of")(self) if model is None else model
        return in_frame(self, frame, mission, orientation_deg)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame with the columns of the track; `attrs` holds units and metadata.

        Raises
        ------
        UsageError
            If pandas is not installed; says how to.
        """
        return _above("relnav.files.data_frames:to_dataframe")(self)

    def to_xarray(self) -> Any:
        """An xarray.Dataset over time: state, covariance and the rest, units as attributes.

        Raises
        ------
        UsageError
            If xarray is not installed; says how to.
        """
        return _above("relnav.files.data_frames:to_xarray")(self)


def _above(place: str) -> Any:
    module, name = place.split(":")
    return getattr(import_module(module), name)
