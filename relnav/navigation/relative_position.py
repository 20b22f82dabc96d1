"""The relative navigation filter, one image at a time."""

from collections.abc import Callable
from importlib.metadata import version
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import Matrix, Vector, number, numbers, one_piece
from relnav.codegen.kernel import ready
from relnav.geometry.rotation import is_rotation
from relnav.mission import Model
from relnav.navigation.arguments import choose, start_values, vector
from relnav.navigation.beacon_geometry import attitude_changed
from relnav.navigation.memory import KEPT_FROM, MOTION, fill, kept_until, named
from relnav.navigation.record import FilterRecord
from relnav.navigation.reference_engine import ReferenceEngine
from relnav.navigation.step import WRONG_SHAPE, step


class Navigator:
    """A relative navigation filter that takes one image at a time.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`.
    method : {"fix", "spots"}
        Measurement model: the closed form's range, azimuth and elevation, or the detector coordinates themselves. `fix`
        needs three spots and makes no use of the camera's attitude, but refuses images that contradict a stated one by
        more than its sigma explains. `spots` uses any of them and finds the angles ten times better;
        an error of the attitude goes straight into them, and the covariance does not know of it.
    projection : {"perspective", "parallel"}, optional
        Closed form of `fix` and of every start; the model's own if left out.
    engine : {"compiled", "filterpy"}
        Ours, or the same filter on filterpy's ExtendedKalmanFilter: hundreds of times slower, for comparison.

    Raises
    ------
    ValueError
        For an unknown method, projection or engine.

    Notes
    -----
    `copy.deepcopy` and `pickle` give a navigator that goes on from the same state, bit for bit.

    Examples
    --------
    >>> import relnav
    >>> navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    >>> record = navigator.step(0.0, [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
    >>> record.status.name
    'WAITING'
    """

    def __init__(
        self, model: Model, method: str = "fix", *, projection: str | None = None, engine: str = "compiled"
    ) -> None:
        self._block = choose(model, method, projection, engine)
        self._step: Callable[[Vector, float, Matrix], int] = ready(step, self._block, 0.0, np.zeros((1, 2)))
        self._reference = ReferenceEngine(self._block) if engine == "filterpy" else None
        if self._reference is not None:
            reference = self._reference
            self._step = lambda _block, t, spots: reference.step(t, spots)
        self._named = named(self._block)
        self._beacons = len(self._named.beacons)
        self._held = self._named.kept["mount"][:, :3].copy()
        self._held_known = int(self._named.sensor["attitude_known"])
        self._kept = self._block[KEPT_FROM : kept_until(self._block)]
        self._changed = False
        self._any_type = isinstance(self._step, FunctionType)  # nothing else refuses other types of numbers
        self._calibration = model.calibration
        self._projection, self._engine = projection, engine
        self.model = model
        self.method = method

    def start(self, t_s: float, state: ArrayLike, covariance: ArrayLike) -> None:
        """Begin from a state that is known otherwise: handed over by relative GPS, say, or by another filter.

        Without it the filter starts itself, on two images that agree.

        Parameters
        ----------
        t_s : float
            Time of the state, after that of the last step; the next step comes after it.
        state, covariance : (6,), (6, 6)
            Chaser relative to target, `lvlh_ccsds`, m and m/s, and its covariance.

        Raises
        ------
        ValueError
            For another shape, what is not finite, or a covariance that is none. The filter is then unchanged.
        """
        t, x, ld = start_values(t_s, state, covariance, MOTION)
        if not t > self._named.clock["t"]:
            raise ValueError(f"t_s must be after the last step's {float(self._named.clock['t'])!r} s; got {t_s!r}")
        m = self._named
        fill(m.track, state=x, ld=ld)
        m.sensitivities[:] = 0.0
        fill(m.clock, t=t, running=1, trial=0, rejected=0, starts=m.clock["starts"] + 1)
        if self._reference is not None:
            self._reference.take_over()

    def __getstate__(self) -> dict[str, Any]:
        """What copies and pickles hold: they go on bit for bit, apart from one another."""
        return {
            "version": version("relnav"),
            "arguments": (self.model, self.method, self._projection, self._engine),
            "memory": self._block.copy(),
            "changed": self._changed,
            "reference": None if self._reference is None else self._reference.tracks(),
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """As it was saved; ValueError if another version of relnav saved it."""
        saved, here = state["version"], version("relnav")
        if saved != here:
            raise ValueError(
                f"a navigator saved by relnav {saved} cannot go on in relnav {here}: its memory may be laid out "
                "otherwise; filter from the log again, or begin from its last state (`start`)"
            )
        model, method, projection, engine = state["arguments"]
        self.__init__(model, method, projection=projection, engine=engine)  # type: ignore[misc]  # made anew, as it was
        self._block[:] = state["memory"]
        self._changed = state["changed"]
        if self._reference is not None:
            self._reference.restore(*state["reference"])

    def step(
        self,
        t_s: float,
        spots_m: ArrayLike,
        *,
        acceleration_m_s2: ArrayLike | None = None,
        delta_v_m_s: ArrayLike | None = None,
        dcm_cam_from_lvlh: ArrayLike | None = None,
        spot_sigma_m: ArrayLike | None = None,
    ) -> FilterRecord:
        """Take one image, and return the state after it.

        Parameters
        ----------
        t_s : float
            Time of the image, after that of the last step.
        spots_m : (3, 2)
            Detector coordinates of beacons A, B, C, m; NaN = not seen.
        acceleration_m_s2 : (3,), optional
            Commanded acceleration in `lvlh_ccsds`, held since the last step.
        delta_v_m_s : (3,), optional
            Impulse in `lvlh_ccsds` just before this image.
        dcm_cam_from_lvlh : (3, 3), optional
            Camera attitude now; the model's if left out.
        spot_sigma_m : (3, 2), optional
            1-sigma of the spots' noise from now on; where it is NaN, or left out, the last one stays. What a
            calibration leaves comes on top.

        Returns
        -------
        FilterRecord
            A bad measurement never raises: it is rejected and reported.

        Raises
        ------
        ValueError
            For wrong use: shapes, a time that does not advance, control or attitude that is not finite. The filter
            is then unchanged.
        """
        if type(spots_m) is not np.ndarray or self._any_type:
            t_s, spots_m = number("t_s", t_s), one_piece("spots_m", spots_m)
        told = not (acceleration_m_s2 is delta_v_m_s is dcm_cam_from_lvlh is spot_sigma_m is None)
        if not (told or self._changed or self._calibration is not None):
            self._take(t_s, spots_m)
            return FilterRecord(self._kept.tobytes())
        before, changed = self._block.copy(), self._changed
        try:
            self._set(acceleration_m_s2, delta_v_m_s, dcm_cam_from_lvlh, spot_sigma_m)
            if self._calibration is not None:
                spots_m, lasting = self._calibration.corrected(one_piece("spots_m", spots_m))
                if lasting.shape == (self._beacons,):  # else `step` says what is wrong with the spots
                    self._named.beacons["lasting_sigma"] = lasting
            self._take(t_s, spots_m)
        except ValueError:
            self._block[:], self._changed = before, changed
            raise
        return FilterRecord(self._kept.tobytes())

    def _take(self, t_s: float, spots_m: Matrix) -> None:
        try:
            outcome = self._step(self._block, t_s, spots_m)
        except (IndexError, OverflowError):  # no plane of spots, or a time beyond all floats
            outcome = NotImplemented
        if outcome is NotImplemented:  # another type of numbers, or an array that is not one piece of memory
            t_s, spots_m = number("t_s", t_s), one_piece("spots_m", spots_m)
            outcome = self._step(self._block, t_s, spots_m) if spots_m.ndim == 2 else WRONG_SHAPE
        if outcome < 0:
            raise self._wrong_use(t_s, spots_m)

    def _wrong_use(self, t_s: float, spots: Matrix) -> ValueError:
        if spots.shape != (self._beacons, 2):
            return ValueError(
                f"spots_m has shape ({self._beacons}, 2), rows A, B, C, columns x, y in metres; got {spots.shape}"
            )
        last = float(self._named.clock["t"])
        return ValueError(f"t_s must be finite and after the last step's {last!r} s; got {t_s!r}")

    def _set(
        self,
        acceleration: ArrayLike | None,
        delta_v: ArrayLike | None,
        dcm: ArrayLike | None,
        spot_sigma: ArrayLike | None,
    ) -> None:
        """Write this step's control, attitude and noise; what is left out is zero, the model's, or the last one."""
        a = None if acceleration is None else vector("acceleration_m_s2", acceleration, (3,))
        v = None if delta_v is None else vector("delta_v_m_s", delta_v, (3,))
        c = self._held if dcm is None else vector("dcm_cam_from_lvlh", dcm, (3, 3))
        if dcm is not None and not is_rotation(c):
            raise ValueError("dcm_cam_from_lvlh must be a rotation matrix (orthonormal, determinant +1)")
        m = self._named
        if spot_sigma is not None:
            sigma = numbers("spot_sigma_m", spot_sigma)
            if sigma.shape != (self._beacons, 2) or np.any(sigma <= 0.0) or np.any(np.isinf(sigma)):
                raise ValueError(
                    f"spot_sigma_m has shape ({self._beacons}, 2), above zero and finite; got {sigma.tolist()}"
                )
            np.copyto(m.beacons["spot_sigma"], sigma, where=sigma > 0.0)
        m.motion["acceleration"] = 0.0 if a is None else a
        m.motion["delta_v"] = 0.0 if v is None else v
        m.kept["mount"][:, :3] = c
        m.sensor["attitude_known"] = self._held_known or dcm is not None
        attitude_changed(m.kept, m.sensor)
        self._changed = not (a is None and v is None and dcm is None)
