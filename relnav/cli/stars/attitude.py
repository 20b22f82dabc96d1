"""`relnav stars attitude`: a star sensor's log of frames as the camera attitudes that `relnav filter` reads."""

from pathlib import Path

import click


@click.command(
    epilog="Example: relnav stars attitude frames.csv --model dual_field_star --orbit orbit.csv --epoch 2026.5 "
    "--earth-velocity-km-s -10.2 25.3 11.0 --out attitude.csv --log approach.csv --joined approach_with_attitude.csv"
)
@click.argument("frames", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--model", required=True, help="Star sensor: a shipped name, a folder or a file.")
@click.option(
    "--orbit",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Target's inertial states (ICRS axes), CSV: t_s, x_km, y_km, z_km, vx_km_s, vy_km_s, vz_km_s.",
)
@click.option("--epoch", help="Julian year or ISO date (UTC); the model's own if left out.")
@click.option(
    "--earth-velocity-km-s",
    nargs=3,
    type=float,
    help="Earth's barycentric velocity, ICRS; with the orbit's it makes the aberration. Needed with two fields.",
)
@click.option(
    "--q-cam-from-star",
    nargs=4,
    type=float,
    default=(0.0, 0.0, 0.0, 1.0),
    show_default=True,
    help="Mounting of the camera, x y z w.",
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Attitudes, .csv or .parquet.")
@click.option("--log", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Navigation log, .csv.")
@click.option("--joined", type=click.Path(path_type=Path), help="That log with the attitude added to every row.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    frames: Path,
    model: str,
    orbit: Path,
    epoch: str | None,
    earth_velocity_km_s: tuple[float, float, float] | None,
    q_cam_from_star: tuple[float, float, float, float],
    out: Path,
    log: Path | None,
    joined: Path | None,
    quiet: bool,
) -> None:
    """Solve FRAMES, a CSV of spots t_s, x_px, y_px and flux or magnitude, and write q_cam_from_lvlh at their times.

    Frames without a credible attitude are left out. With --log and --joined the attitude goes into every row of a
    navigation log, which `relnav filter` then reads.
    """
    import numpy as np

    from relnav.errors import InputError, UsageError
    from relnav.files.atomic import check_distinct, check_folder
    from relnav.files.attitude_log import quaternions_in_lvlh, read_orbit, read_star_log, states_at, write_attitudes
    from relnav.files.epochs import julian_year
    from relnav.files.star_solving import load_star_sensor, velocity_option
    from relnav.files.tables import check_format
    from relnav.geometry.rotation import dcm_from_quaternion
    from relnav.sensors.dual_field import measure

    check_format(out)
    for path in (out, joined):
        if path is not None:
            check_folder(path)
    check_distinct(frames, orbit, log, out, joined)
    if (log is None) != (joined is None):
        raise UsageError("--log and --joined go together: the navigation log to read, and the one to write")
    sensor = load_star_sensor(model)
    if sensor.fold.kind != "none" and earth_velocity_km_s is None:
        raise UsageError("two fields need --earth-velocity-km-s: aberration changes the angle between them")
    earth = None if earth_velocity_km_s is None else velocity_option("--earth-velocity-km-s", earth_velocity_km_s)
    year = None if epoch is None else julian_year(epoch)
    images, states = read_star_log(frames), read_orbit(orbit)
    at = states_at(states, np.array([t for t, _ in images]), orbit)
    solved, solutions = [], []
    for k, (_, frame) in enumerate(images):
        velocity = None if earth is None else earth + at[k, 3:]
        solution = measure(
            frame.spots_px,
            sensor,
            flux=frame.flux,
            magnitude=frame.magnitude,
            epoch_jyear=year,
            velocity_km_s=velocity,
        )
        if solution.ok:
            solved.append(k)
            solutions.append(solution)
    if not solved:
        raise InputError(f"{frames}: no frame of {len(images)} has a credible attitude; `relnav stars solve` tells why")
    t_s = np.array([images[k][0] for k in solved])
    try:
        mounting = dcm_from_quaternion(np.array(q_cam_from_star))
    except ValueError as error:
        raise UsageError(f"--q-cam-from-star: {error}") from error
    q = quaternions_in_lvlh(np.array([s.dcm_cam_from_icrs for s in solutions]), at[solved], mounting)
    rows = write_attitudes(out, t_s, q, np.array([s.sigma_rad for s in solutions]), log, joined)
    if not quiet:
        click.echo(f"attitude: {out} ({len(solved)} of {len(images)} frames)")
        if joined is not None:
            click.echo(f"log: {joined} ({rows} rows)")
