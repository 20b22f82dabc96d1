"""The relative navigation filter, one image at a time."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from string import ascii_uppercase as letters
from types import BuiltinFunctionType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Vector, number, numbers, of_floats, one_piece, vector
from relnav.codegen.kernel import plain, ready
from relnav.codegen.python_members import method_of, read_by_machine_code
from relnav.dynamics.error_state import MOTION
from relnav.geometry.rotation import is_rotation
from relnav.mission import Model
from relnav.navigation.arguments import choose, not_negative, refuse_another_version, start_values, told_time
from relnav.navigation.blocks import attitude_counts, beacon_layout
from relnav.navigation.epoch_report import (
    ACCELERATION,
    ATTITUDE,
    ATTITUDE_NOISE,
    ATTITUDE_SIGMA,
    DELTA_V,
    SPOT_SIGMA,
    navigate,
    new_report,
    take_inputs,
    write_report,
)
from relnav.navigation.late_images import Image, Inputs, LateImages
from relnav.navigation.memory import fill, views, watch_anew
from relnav.navigation.record import FilterRecord
from relnav.navigation.reference import for_beacons
from relnav.navigation.step import wrong_use

NOTHING, NO_MATRIX = np.empty(0), np.empty((0, 0))
"""What is not told."""


class Navigator:
    """A relative navigation filter that takes one image at a time.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`.
    method : {"fix", "spots"}
        Measurement model: the closed form's range, azimuth and elevation, or the detector coordinates themselves. `fix`
        needs three spots and does not use the camera's attitude, but rejects images that contradict a stated one by
        more than its sigma explains. `spots` uses any number of them; its angles are ten times more accurate if the
        attitude is exact. An attitude error is an error of the angles; the covariance includes the one that the model
        states.
    projection : {"perspective", "parallel"}, optional
        Closed form of `fix` and of every start; the model's own if left out.
    engine : {"compiled", "filterpy"}
        relnav's own filter, or the same one written a second time in numpy on filterpy's ExtendedKalmanFilter: hundreds
        of times slower, for comparison. Its alarm says UNWATCHED.

    Attributes
    ----------
    layout : StateLayout
        The errors that it estimates and considers, by name; `print` shows them.

    Raises
    ------
    ValueError
        For an unknown method, projection or engine.

    Notes
    -----
    `copy.deepcopy` and `pickle` give a navigator that continues from the same state, bit for bit.

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
        self._named = views(self._block)
        self._beacons = len(self._named.beacons)
        self._report, self._kept = new_report(self._beacons)
        self._reference = for_beacons(engine, model, method, projection, self._block)
        given = self._block, 0.0, NO_MATRIX, 0, NOTHING, NOTHING, NO_MATRIX, NO_MATRIX, 0.0, 0.0, self._report
        self._navigate: Callable[..., Any] = ready(navigate, *given) if self._reference is None else self._by_reference
        self.layout = beacon_layout(model, method)
        carried = "chaser_attitude" in self.layout.by_name
        self._carries_attitude = carried or not attitude_counts(model, method)
        self._calibration = model.calibration
        self._at_once = isinstance(self._navigate, BuiltinFunctionType) and self._calibration is None
        self._late: LateImages | None = None
        delay = model.filter.longest_delay_s
        if delay > 0.0 and self._reference is None:
            beacons = self._named.beacons
            self._late = LateImages(self._block, beacons, self._navigate, self._report, self._kept, delay)
            self._at_once = False
        self._projection, self._engine = projection, engine
        if self._at_once and type(self).step is Navigator.step:
            self._step_by_machine_code()
        self.model = model
        self.method = method

    def _step_by_machine_code(self) -> None:
        """Let `step` be one call from Python where nothing unusual is given, and records be read in one."""
        read_by_machine_code(FilterRecord)
        by_call = method_of(
            self.step,
            self._navigate,
            before=(self._block,),
            keywords=("acceleration_m_s2", "delta_v_m_s", "dcm_cam_from_lvlh", "spot_sigma_m"),  # as the bits of `told`
            after=(0.0, 0.0, self._report),
            kept=self._kept,
            record=FilterRecord,
        )
        if by_call is not None:
            self.step = by_call  # type: ignore[method-assign]  # the same method

    def __repr__(self) -> str:
        """One line for the console."""
        clock = self._named.clock
        known = "with a state" if clock["running"] else "WAITING for two images that agree"
        return f"{type(self).__name__}({self.model.name}, {self.method}, {told_time(float(clock['t']))}, {known})"

    def start(self, t_s: float, state: ArrayLike, covariance: ArrayLike) -> None:
        """Start from a known state, such as that of relative GPS or of another filter.

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
            For another shape, what is not finite, or an invalid covariance. The filter is then unchanged.
        """
        t, x, ld = start_values(t_s, state, covariance, MOTION)
        if not t > self._named.clock["t"]:
            raise ValueError(f"t_s must be after the last step's {float(self._named.clock['t'])!r} s; got {t_s!r}")
        m = self._named
        fill(m.track, state=x, ld=ld)
        m.sensitivities[:] = 0.0
        watch_anew(m.watch, m.watched)
        fill(m.clock, t=t, running=1, trial=0, rejected=0, starts=m.clock["starts"] + 1)
        if self._reference is not None:
            self._reference.take_over(t, x, ld)
        if self._late is not None:
            self._late.begin(t)

    def __getstate__(self) -> dict[str, Any]:
        """What copies and pickles hold: they go on bit for bit, apart from one another."""
        return {
            "version": version("relnav"),
            "arguments": (self.model, self.method, self._projection, self._engine),
            "memory": self._block.copy(),
            "reference": None if self._reference is None else self._reference.saved(),
            "timeline": None if self._late is None else self._late.timeline,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """As it was saved; ValueError if another version of relnav saved it."""
        refuse_another_version(state["version"])
        model, method, projection, engine = state["arguments"]
        self.__init__(model, method, projection=projection, engine=engine)  # type: ignore[misc]  # made anew, as it was
        self._block[:] = state["memory"]
        if self._reference is not None:
            self._reference.restore(state["reference"])
        if self._late is not None:
            self._late.timeline = state["timeline"]

    def step(
        self,
        t_s: float,
        spots_m: ArrayLike,
        *,
        image_t_s: float | None = None,
        acceleration_m_s2: ArrayLike | None = None,
        delta_v_m_s: ArrayLike | None = None,
        dcm_cam_from_lvlh: ArrayLike | None = None,
        spot_sigma_m: ArrayLike | None = None,
        attitude_noise_rad: float | None = None,
        attitude_sigma_rad: float | None = None,
    ) -> FilterRecord:
        """Process one image, and return the state after it.

        Parameters
        ----------
        t_s : float
            Time of the state, and of the image unless `image_t_s` says another; after that of the last step, or at it
            with an image that is late.
        spots_m : (n, 2)
            Detector coordinates, m, one row for each of the model's beacons: A, B, C, then `extra_beacons_m` in their
            order; NaN = not seen.
        image_t_s : float, optional
            Middle of the exposure, at most the model's `longest_delay_s` before t_s: the image is inserted there, and
            all later events are processed again. An image that is later than that is not used (`TOO_LATE`). Attitude
            and noise of the call are those at the exposure too.
        acceleration_m_s2 : (3,), optional
            Commanded acceleration in `lvlh_ccsds`, held since the last step.
        delta_v_m_s : (3,), optional
            Impulse in `lvlh_ccsds` just before this image.
        dcm_cam_from_lvlh : (3, 3), optional
            Camera attitude now; the model's if left out.
        spot_sigma_m : (n, 2), optional
            1-sigma of the spots' noise from now on; where it is NaN, or left out, the last one stays. The residual of a
            calibration is added.
        attitude_noise_rad : float, optional
            1-sigma about each axis of the part of the attitude error that is new at each image, from now on; the
            model's if never stated.
        attitude_sigma_rad : float, optional
            1-sigma about each axis of the constant part of the attitude error, from now on; the model's (`[attitude]
            sigma_deg`) if never stated. It remains one error with another sigma: stated at every image it is still not
            noise.

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
        told = ACCELERATION if acceleration_m_s2 is not None else 0
        if delta_v_m_s is not None:
            told |= DELTA_V
        if dcm_cam_from_lvlh is not None:
            told |= ATTITUDE
        if spot_sigma_m is not None:
            told |= SPOT_SIGMA
        noise = lasting = 0.0
        if attitude_noise_rad is not None:
            told, noise = told | ATTITUDE_NOISE, not_negative("attitude_noise_rad", attitude_noise_rad)
        if attitude_sigma_rad is not None:
            told, lasting = told | ATTITUDE_SIGMA, self._lasting(attitude_sigma_rad)
        try:
            if (
                self._at_once
                and image_t_s is None
                and (
                    self._navigate(
                        self._block,
                        t_s,
                        of_floats(spots_m),
                        told,
                        of_floats(acceleration_m_s2),
                        of_floats(delta_v_m_s),
                        dcm_cam_from_lvlh,
                        spot_sigma_m,
                        noise,
                        lasting,
                        self._report,
                    )
                    is True
                )
            ):
                return FilterRecord(self._kept.tobytes())
        except OverflowError:  # a time beyond all floats: refused below
            pass
        arrays = self._checked(acceleration_m_s2, delta_v_m_s, dcm_cam_from_lvlh, spot_sigma_m)
        inputs = Inputs(told, *arrays, noise, lasting)
        if self._late is not None:
            return self._take_late(self._late, t_s, spots_m, image_t_s, inputs)
        if image_t_s is not None and number("image_t_s", image_t_s) != number("t_s", t_s):
            raise ValueError(
                f"image_t_s {image_t_s!r} is not t_s = {t_s!r}: images come at once here; for late ones give the "
                "model's [filter] a longest_delay_s (engine='filterpy' takes none)"
            )
        self._take(t_s, spots_m, inputs)
        return FilterRecord(self._kept.tobytes())

    def _take_late(
        self, late: LateImages, t_s: float, spots_m: ArrayLike, image_t_s: float | None, inputs: Inputs
    ) -> FilterRecord:
        """Take an image whose exposure may lie before t_s."""
        t, spots, lasting = number("t_s", t_s), one_piece("spots_m", spots_m), None
        exposed = t if image_t_s is None else number("image_t_s", image_t_s)
        late.check(t, exposed, inputs.told)
        if spots.shape != (self._beacons, 2):
            raise self._wrong_use(t_s, spots)
        if self._calibration is not None:
            spots, lasting = self._calibration.corrected(spots)
        return FilterRecord(late.take(t, Image(exposed, spots, lasting, inputs)))

    def _take(self, t_s: float, spots_m: ArrayLike, inputs: Inputs) -> None:
        """Take an image whose numbers are of any type, or that is to be corrected, or say what is wrong with it."""
        t, spots, before = number("t_s", t_s), one_piece("spots_m", spots_m), self._block.copy()
        if self._calibration is not None:
            spots, lasting = self._calibration.corrected(spots)
            if lasting.shape == (self._beacons,):  # else the spots are refused below
                self._named.beacons["lasting_sigma"] = lasting
                if self._reference is not None:
                    self._reference.optics.lasting = lasting
        if spots.ndim != 2 or self._navigate(self._block, t, spots, *inputs, self._report) is not True:
            self._block[:] = before
            raise self._wrong_use(t_s, spots)

    def _wrong_use(self, t_s: float, spots: Matrix) -> ValueError:
        if spots.shape != (self._beacons, 2):
            rows = ", ".join(letters[: self._beacons])
            return ValueError(
                f"spots_m has shape ({self._beacons}, 2), rows {rows}, columns x, y in metres; got {spots.shape}"
            )
        last = float(self._named.clock["t"])
        return ValueError(f"t_s must be finite and after the last step's {last!r} s; got {t_s!r}")

    def _lasting(self, value: float) -> float:
        """A lasting sigma of the attitude; ValueError where the filter has no place for that error."""
        sigma = not_negative("attitude_sigma_rad", value)
        if sigma > 0.0 and not self._carries_attitude:
            raise ValueError(
                f"attitude_sigma_rad = {value!r}: {self.model.name} is stated without a lasting attitude error, so "
                "that the filter carries none; state one in the model ([attitude] sigma_deg above 0)"
            )
        return sigma

    def _checked(
        self,
        acceleration: ArrayLike | None,
        delta_v: ArrayLike | None,
        dcm: ArrayLike | None,
        spot_sigma: ArrayLike | None,
    ) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """What is told as arrays in one piece, empty where nothing is; ValueError for what cannot be taken."""
        a = NOTHING if acceleration is None else vector("acceleration_m_s2", acceleration, (3,))
        v = NOTHING if delta_v is None else vector("delta_v_m_s", delta_v, (3,))
        c = NO_MATRIX if dcm is None else vector("dcm_cam_from_lvlh", dcm, (3, 3), np.inf)
        if dcm is not None and not is_rotation(c):
            raise ValueError("dcm_cam_from_lvlh must be a rotation matrix (orthonormal, determinant +1)")
        sigma = NO_MATRIX if spot_sigma is None else numbers("spot_sigma_m", spot_sigma)
        if spot_sigma is not None and (
            sigma.shape != (self._beacons, 2) or np.any(sigma <= 0.0) or np.any(sigma > LARGEST)
        ):
            raise ValueError(
                f"spot_sigma_m has shape ({self._beacons}, 2), above zero, up to {LARGEST:g}; got {sigma.tolist()}"
            )
        return np.ascontiguousarray(a), np.ascontiguousarray(v), np.ascontiguousarray(c), np.ascontiguousarray(sigma)

    def _by_reference(self, block: Vector, t: float, spots: Matrix, *more: Any) -> bool:
        """`navigate` with the reference engine's step."""
        *inputs, report = more
        assert self._reference is not None
        if plain(wrong_use)(self._named, t, spots) != 0 or not take_inputs(block, *inputs):
            return False
        self._reference.tell(*inputs)
        self._reference.step(t, spots)
        write_report(block, report)
        return True
