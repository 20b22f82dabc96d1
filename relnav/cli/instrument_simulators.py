"""What `relnav simulate` makes of star and sun sensors: logs of frames with their truth, or one picture."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Vector
from relnav.cli.simulators import Options, Simulated
from relnav.errors import UsageError
from relnav.files.images import is_picture, write_picture
from relnav.files.sun_logs import columns_of
from relnav.files.tables import check_format, relnav_version, write_table
from relnav.geometry.projection_angles import direction_from_angles
from relnav.geometry.rotation import quaternion_from_dcm
from relnav.geometry.rotation_vector import turned
from relnav.sensors.aps_sun import ApsSunModel
from relnav.sensors.birefringent_sun import BirefringentSunModel
from relnav.sensors.dual_field import StarSensor
from relnav.simulation.star_field import SimulatedStars, SkyConditions, StarFieldSimulator, random_velocity
from relnav.simulation.star_picture import Exposure, picture_of
from relnav.simulation.sun_spot import read_out, render_spot, render_two_spots
from relnav.simulation.trajectory import Approach

TURN_RAD_S = 1.1e-3
"""Rate of a star sensor about its y axis: that of a low orbit."""
SWEEPS = (3.0, 5.0)
"""Cycles of alpha and beta of a simulated sun during a run: a figure that covers the field."""
FIELD_SHARE = 0.95
INSTRUMENTS = (StarSensor, ApsSunModel, BirefringentSunModel)


def simulate_instrument(mission: Any, approach: Approach, options: Options, out: Path) -> Simulated:
    """Frames of a star sensor that turns, or of a sun sensor under a moving sun; one picture if `out` is one.

    Raises
    ------
    UsageError
        For options of an approach.
    """
    if options.hidden or options.raw or options.received_power or options.as_built or options.distortion_m:
        raise UsageError(f"--hide, --raw, --received-power, --as-built, --distortion are not for {mission.name}")
    if options.outliers and not isinstance(mission, StarSensor):
        raise UsageError(f"--outliers are not for {mission.name}; --dropout is")
    rng = np.random.default_rng(options.seed)
    if isinstance(mission, StarSensor):
        simulator = _StarRun(mission, options, rng)
        return simulator.picture() if is_picture(out) else simulator.log(approach)
    if is_picture(out):
        return _sun_picture(mission, rng)
    return _sun_log(mission, approach, options, rng)


class _StarRun:
    """A star sensor on its way: one mounting of the mirror, one velocity, one turn."""

    def __init__(self, model: StarSensor, options: Options, rng: np.random.Generator) -> None:
        self.model, self.rng = model, rng
        camera = model.camera
        radius = float(np.arctan(0.5 * np.hypot(*camera.detector_size_px) / camera.focal_length_px))
        faintest = min(model.identification.faintest_star_mag, model.identification.faintest_pair_mag + 0.2)
        conditions = SkyConditions(
            faintest_mag=faintest, missing=options.dropout, false_spots=0, field_radius_rad=min(radius, 0.5)
        )
        self.simulator = StarFieldSimulator(model, conditions)
        self.simulator.mount(rng)
        self.false = options.outliers
        self.velocity = random_velocity(rng)

    def frame(self, dcm: Matrix | None = None) -> SimulatedStars:
        """One frame; stars beyond the detector fall away."""
        frame = self.simulator.frame(self.rng, velocity_km_s=self.velocity, dcm=dcm)
        half = 0.5 * np.asarray(self.model.camera.detector_size_px)
        inside = np.all(np.abs(frame.spots_px) < half, axis=1)
        stray = inside & (self.rng.random(len(inside)) < self.false)
        spots = np.where(stray[:, None], self.rng.uniform(-half, half, frame.spots_px.shape), frame.spots_px)
        return dataclasses.replace(
            frame,
            spots_px=spots[inside],
            magnitude=frame.magnitude[inside],
            hip=frame.hip[inside],
            field=frame.field[inside],
        )

    def stated(self, metadata: dict[str, str]) -> dict[str, str]:
        """The head of every file: what a solver must be told."""
        velocity = " ".join(f"{value:.6f}" for value in self.velocity)
        year = f"{self.model.identification.epoch_jyear:g}"
        return {"relnav": relnav_version()} | metadata | {"epoch_jyear": year, "velocity_km_s": velocity}

    def picture(self) -> Simulated:
        """One exposure."""
        frame, camera = self.frame(), self.model.camera
        exposure = Exposure(zero_point=self.model.identification.magnitude_zero_point or Exposure.zero_point)
        width, height = (round(side) for side in camera.detector_size_px)
        counts = picture_of(frame.spots_px, exposure.flux(frame.magnitude), (width, height), exposure, self.rng)
        return Simulated(
            1,
            lambda path, metadata: write_picture(counts.astype(np.uint16), self.stated(metadata), path),
            lambda path, metadata: self._write_truth([(0.0, frame.dcm_cam_from_icrs)], path, metadata),
            "picture",
        )

    def log(self, approach: Approach) -> Simulated:
        """Frames at the rate of the approach."""
        times, frames = _times(approach), []
        first = self.frame().dcm_cam_from_icrs
        for t in times:
            frames.append(self.frame(turned(first, np.array([0.0, TURN_RAD_S * float(t), 0.0]))))

        def write_log(path: Path, metadata: dict[str, str]) -> None:
            check_format(path)
            table = np.concatenate(
                [
                    np.column_stack([np.full(len(frame.magnitude), t), frame.spots_px, frame.magnitude])
                    for t, frame in zip(times, frames, strict=True)
                ]
            )
            write_table(path, ("t_s", "x_px", "y_px", "magnitude"), iter([list(table.T)]), self.stated(metadata), ())

        def write_truth(path: Path, metadata: dict[str, str]) -> None:
            self._write_truth(
                [(float(t), frame.dcm_cam_from_icrs) for t, frame in zip(times, frames, strict=True)], path, metadata
            )

        return Simulated(len(times), write_log, write_truth, "frames")

    def _write_truth(self, rows: list[tuple[float, Matrix]], path: Path, metadata: dict[str, str]) -> None:
        check_format(path)
        names = ("t_s", *(f"q_cam_from_icrs_{axis}" for axis in "xyzw"))
        table = np.array([[t, *quaternion_from_dcm(dcm)] for t, dcm in rows])
        write_table(path, names, iter([list(table.T)]), self.stated(metadata), ())


def _times(approach: Approach) -> Vector:
    return np.arange(max(1, round(approach.duration_s * approach.rate_hz)), dtype=np.float64) / approach.rate_hz


def _sun_path(model: ApsSunModel | BirefringentSunModel, times: Vector) -> Matrix:
    """Directions (n, 3) of a sun that covers the field."""
    half = FIELD_SHARE * model.sensor.field_half_angle_rad * (1.0 if isinstance(model, ApsSunModel) else np.sqrt(0.5))
    phase = 2.0 * np.pi * times / max(float(times[-1]), 1.0)
    return direction_from_angles(half * np.sin(SWEEPS[0] * phase), half * np.cos(SWEEPS[1] * phase))


def _sun_log(
    model: ApsSunModel | BirefringentSunModel, approach: Approach, options: Options, rng: np.random.Generator
) -> Simulated:
    from relnav.sensors.aps_sun.rays import project
    from relnav.sensors.birefringent_sun.spots import project as project_two

    times = _times(approach)
    s = _sun_path(model, times)
    spots = project(model, s)[:, None] if isinstance(model, ApsSunModel) else project_two(model.sensor, s)
    spots = spots + model.sensor.spot_noise_px * rng.normal(size=spots.shape)
    spots[rng.random(spots.shape[:2]) < options.dropout] = np.nan
    columns = columns_of(spots.shape[1])

    def write_log(path: Path, metadata: dict[str, str]) -> None:
        check_format(path)
        head = {"relnav": relnav_version()} | metadata
        write_table(path, ("t_s", *columns), iter([[times, *spots.reshape(len(times), -1).T]]), head, ())

    return Simulated(
        len(times), write_log, lambda path, metadata: _write_directions(times, s, path, metadata), "images"
    )


def _sun_picture(model: ApsSunModel | BirefringentSunModel, rng: np.random.Generator) -> Simulated:
    """One read-out of the whole detector, the sun anywhere in the field."""
    half = FIELD_SHARE * model.sensor.field_half_angle_rad * np.sqrt(0.5)
    s = direction_from_angles(*rng.uniform(-half, half, 2))
    window = render_spot(model, s) if isinstance(model, ApsSunModel) else render_two_spots(model, s)
    width, height = model.sensor.detector_size_px
    electrons = np.zeros((height, width))
    (x, y), (rows, columns) = window.corner_px, window.electrons.shape
    inside = slice(max(0, -y), min(rows, height - y)), slice(max(0, -x), min(columns, width - x))
    electrons[max(0, y) : y + rows, max(0, x) : x + columns] = window.electrons[inside]
    counts = read_out(dataclasses.replace(window, electrons=electrons), model.image, rng).astype(np.uint16)
    return Simulated(
        1,
        lambda path, metadata: write_picture(counts, {"relnav": relnav_version()} | metadata, path),
        lambda path, metadata: _write_directions(np.zeros(1), s[None], path, metadata),
        "picture",
    )


def _write_directions(times: Vector, s: Matrix, path: Path, metadata: dict[str, str]) -> None:
    check_format(path)
    angles = np.degrees(np.arctan2(s[:, :2], s[:, 2:]))
    head = {"relnav": relnav_version(), "axes": "sensor, z boresight"} | metadata
    write_table(path, ("t_s", "alpha_deg", "beta_deg", "x", "y", "z"), iter([[times, *angles.T, *s.T]]), head, ())
