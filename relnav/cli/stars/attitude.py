"""`relnav stars attitude`: a star sensor's log of frames as the camera attitudes that `relnav filter` reads."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from relnav.cli.completion import STARS, ModelName
from relnav.cli.printing import InputPath, OutputPath, say
from relnav.cli.stars import RESIDUAL

if TYPE_CHECKING:
    from relnav.arrays import Matrix


@click.command(
    epilog="Example: relnav stars attitude frames.csv --model dual_field_star --orbit orbit.csv --epoch 2026.5 "
    "--earth-velocity-km-s -10.2 25.3 11.0 --out attitude.csv --log approach.csv --joined approach_with_attitude.csv"
)
@click.argument("frames", type=InputPath())
@click.option("--model", type=ModelName(*STARS), required=True, help="Star sensor: a shipped name, a folder or a file.")
@click.option(
    "--orbit",
    type=InputPath(),
    help="Target's inertial states (ICRS axes), CSV: t_s, x_km, y_km, z_km, vx_km_s, vy_km_s, vz_km_s. Without it "
    "attitudes are inertial: q_cam_from_icrs.",
)
@click.option("--epoch", help="Julian year or ISO date (UTC); the model's own if left out.")
@click.option(
    "--earth-velocity-km-s",
    nargs=3,
    type=float,
    help="Earth's barycentric velocity, ICRS; with the orbit's it gives the aberration. Needed with two fields.",
)
@click.option(
    "--q-cam-from-star",
    nargs=4,
    type=float,
    default=(0.0, 0.0, 0.0, 1.0),
    show_default=True,
    help="Mounting of the camera, x y z w.",
)
@click.option(
    "--track",
    is_flag=True,
    help="Try an unsolved frame again near the attitude extrapolated from the two before; two stars can be enough.",
)
@click.option("--residual-px", type=click.FloatRange(min=0.0, max=1e3), help=RESIDUAL)
@click.option("--out", required=True, type=OutputPath(), help="Attitudes, .csv or .parquet.")
@click.option("--log", type=InputPath(), help="Navigation log, .csv.")
@click.option("--joined", type=OutputPath(), help="That log with the attitude added to every row.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    frames: Path,
    model: str,
    orbit: Path | None,
    epoch: str | None,
    earth_velocity_km_s: tuple[float, float, float] | None,
    q_cam_from_star: tuple[float, float, float, float],
    track: bool,
    residual_px: float | None,
    out: Path,
    log: Path | None,
    joined: Path | None,
    quiet: bool,
) -> None:
    """Solve FRAMES, a CSV of spots t_s, x_px, y_px and flux or magnitude, and write q_cam_from_lvlh at their times.

    Without --orbit it is q_cam_from_icrs. Frames that are not solved are left out. With --log and --joined the attitude
    is added to every row of a navigation log, which `relnav filter` then reads.
    """
    import numpy as np

    from relnav.errors import InputError, UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.attitude_log import (
        join_attitude,
        quaternions_in_lvlh,
        quaternions_inertial,
        read_orbit,
        read_star_log,
        states_at,
        write_attitude_log,
    )
    from relnav.files.epochs import julian_year
    from relnav.files.star_solving import load_star_sensor, origin_of_spots, velocity_option
    from relnav.files.star_tracking import FrameSolver
    from relnav.files.tables import check_format

    check_format(out)
    for path in (out, joined):
        if path is not None:
            check_folder(path)
    check_distinct(frames, orbit, log, out, joined)
    if (log is None) != (joined is None):
        raise UsageError("--log and --joined go together: the navigation log to read, and the one to write")
    if log is not None and orbit is None:
        raise UsageError("--log needs --orbit: a navigation log has attitudes against the orbital frame")
    sensor = load_star_sensor(model)
    if sensor.fold.kind != "none" and earth_velocity_km_s is None:
        raise UsageError("two fields need --earth-velocity-km-s: aberration changes the angle between them")
    earth = None if earth_velocity_km_s is None else velocity_option("--earth-velocity-km-s", earth_velocity_km_s)
    year, mounting = None if epoch is None else julian_year(epoch), _mounting(q_cam_from_star)
    images = read_star_log(frames, origin_of_spots(sensor), residual_px=residual_px)
    times = np.array([t for t, _ in images])
    at = None if orbit is None else states_at(read_orbit(orbit), times, orbit)
    solver, solved, solutions = FrameSolver(sensor, year, track), [], []
    for k, (t, frame) in enumerate(images):
        moved = np.zeros(3) if at is None else at[k, 3:]
        solution = solver.solve(t, frame, None if earth is None else earth + moved)
        if solution.ok:
            solved.append(k)
            solutions.append(solution)
    if not solved:
        raise InputError(f"{frames}: no frame of {len(images)} has a credible attitude; `relnav stars solve` tells why")
    t_s, found = times[solved], np.array([s.dcm_cam_from_icrs for s in solutions])
    q = quaternions_inertial(found, mounting) if at is None else quaternions_in_lvlh(found, at[solved], mounting)
    with Outputs() as outputs:
        sigma = np.array([s.sigma_rad for s in solutions])
        write_attitude_log(outputs.path(out, ".csv"), t_s, q, sigma, inertial=at is None)
        rows = 0
        if log is not None and joined is not None:
            rows = join_attitude(log, t_s, q, outputs.path(joined, ".csv"))
    if not quiet:
        also = [f"log: {joined} ({rows} rows)"] if joined is not None else []
        tracked = f", {solver.tracked} of them tracked" if track else ""
        say([f"attitude: {out} ({len(solved)} of {len(images)} frames{tracked})", *also], out, joined)


def _mounting(q_cam_from_star: tuple[float, float, float, float]) -> "Matrix":
    import numpy as np

    from relnav.errors import UsageError
    from relnav.geometry.rotation import dcm_from_quaternion

    try:
        return dcm_from_quaternion(np.array(q_cam_from_star))
    except ValueError as error:
        raise UsageError(f"--q-cam-from-star: {error}") from error
