"""`relnav stars solve`: inertial attitude and matched stars of one frame of spots."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from relnav.cli.printing import InputPath, OutputPath, say

if TYPE_CHECKING:
    from relnav.sensors.dual_field.solution import StarSolution

ARCSEC = 648000.0 / math.pi


@click.command(epilog="Example: relnav stars solve frame.csv --model ground_camera --json out.json --plot field.png")
@click.argument("frame", type=InputPath())
@click.option("--model", help="Star sensor: a shipped name, a folder or a file.")
@click.option(
    "--focal-px",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Focal length, px, known to 5 %: it is estimated. Without --model nothing else of the camera is needed.",
)
@click.option("--centre-px", nargs=2, type=float, default=(0.0, 0.0), help="Image centre in the file's coordinates.")
@click.option(
    "--image-size-px",
    nargs=2,
    type=click.FloatRange(min=1.0),
    help="Width and height, where spots count from a corner.",
)
@click.option(
    "--first-pixel-px",
    type=click.Choice(["0", "0.5"]),
    default="0",
    show_default=True,
    help="Coordinate of the first pixel's centre, with --image-size-px.",
)
@click.option("--epoch", help="Julian year or ISO date (UTC) of the frame.")
@click.option(
    "--velocity-km-s", nargs=3, type=float, help="Observer's barycentric velocity, ICRS: corrects for aberration."
)
@click.option("--json", "json_path", type=OutputPath(), help="Write the solution as one JSON object.")
@click.option("--plot", type=OutputPath(), help="Draw spots and stars, .png.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    frame: Path,
    model: str | None,
    focal_px: float | None,
    centre_px: tuple[float, float],
    image_size_px: tuple[float, float] | None,
    first_pixel_px: str,
    epoch: str | None,
    velocity_km_s: tuple[float, float, float] | None,
    json_path: Path | None,
    plot: Path | None,
    quiet: bool,
) -> None:
    """Find the inertial attitude of FRAME, a CSV of spots x_px, y_px (from the centre, x right, y down) and flux.

    Right ascension and declination are those of camera +z (for a model its optical axis, else the image centre); roll
    is atan2(-A[0,2], A[1,2]) of dcm_cam_from_icrs. A frame without a credible attitude is refused, with a reason.
    """
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder, check_png
    from relnav.files.epochs import julian_year
    from relnav.files.star_frames import image_centre, read_star_frame
    from relnav.files.star_solutions import draw_solution, solution_values
    from relnav.files.star_solving import solve_frame
    from relnav.files.tables import write_json

    for path in (json_path, plot):
        if path is not None:
            check_folder(path)
    check_distinct(frame, json_path, plot)
    if plot is not None:
        check_png(plot)
    if velocity_km_s is not None and epoch is None:
        raise UsageError("--velocity-km-s needs --epoch as well: the velocity belongs to a time")
    if not all(math.isfinite(value) for value in centre_px):
        raise UsageError(f"--centre-px is two numbers of pixels; got {centre_px[0]} {centre_px[1]}")
    if image_size_px is not None:
        if centre_px != (0.0, 0.0):
            raise UsageError("--centre-px and --image-size-px say the same; keep one")
        centre_px = image_centre(image_size_px, float(first_pixel_px))
    year = None if epoch is None else julian_year(epoch)
    spots = read_star_frame(frame, centre_px)
    solution = solve_frame(spots, model, focal_px, year, velocity_km_s)
    head = {"frame": str(frame), "model": model, "epoch_jyear": year, "velocity_km_s": velocity_km_s}
    origin = {"centre_px": list(centre_px)}
    with Outputs() as outputs:
        if json_path is not None:
            values = solution_values(solution, spots.spots_px) | head | origin
            write_json(values, outputs.path(json_path))
        if plot is not None:
            title = f"{frame.name}: {solution.status}, {solution.matches} of {len(spots.spots_px)} spots are stars"
            draw_solution(solution, spots.spots_px, title, outputs.path(plot, ".png"))
    if not quiet:
        say(solution_lines(solution, len(spots.spots_px)), json_path, plot)


def solution_lines(solution: "StarSolution", spots: int) -> list[str]:
    """A solution for a reader."""
    if not solution.ok:
        return [f"{solution.status}: {solution.reason}"]
    ra, dec, roll = (math.degrees(angle) for angle in solution.ra_dec_roll_rad)
    sigma = solution.sigma_rad * ARCSEC
    fields = solution.matches_per_field
    where = f" ({fields[0]} in field 0, {fields[1]} in field 1)" if fields[1] else ""
    lines = [
        f"{solution.status}: right ascension {ra:.6f} deg, declination {dec:.6f} deg, roll {roll:.5f} deg",
        f"1-sigma about camera x, y, z: {sigma[0]:.2f}, {sigma[1]:.2f}, {sigma[2]:.2f} arcsec",
        f"{solution.matches} of {spots} spots are stars{where}; focal length {solution.focal_length_px:.2f} px; "
        f"probability of chance below 1e{solution.log10_false_alarm:.0f}",
    ]
    return [*lines, solution.reason] if solution.reason else lines
