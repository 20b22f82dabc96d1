"""`relnav stars solve`: inertial attitude and matched stars of one picture, or of one frame of spots."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.completion import STARS, ModelName
from relnav.cli.printing import InputPath, OutputPath, say
from relnav.cli.stars import RESIDUAL

if TYPE_CHECKING:
    from relnav.files.atomic import Outputs
    from relnav.files.star_pictures import Seen
    from relnav.sensors.dual_field.solution import StarSolution

ARCSEC = 648000.0 / math.pi


@click.command(epilog="Example: relnav stars solve sky.png --focal-px 5200 --wcs sky.fits --plot field.png")
@click.argument("frame", type=InputPath())
@click.option("--model", type=ModelName(*STARS), help="Star sensor: a shipped name, a folder or a file.")
@click.option(
    "--focal-px",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Focal length, px, known to 5 %: it is estimated. Without --model nothing else of the camera is needed.",
)
@click.option(
    "--focal-error",
    type=click.FloatRange(5.0, 50.0),
    default=5.0,
    show_default=True,
    help="Uncertainty of --focal-px, %; above 5 several values are tried.",
)
@click.option(
    "--mirrored", is_flag=True, help="The picture is mirrored: y counts up. Attitude and model are unmirrored."
)
@click.option("--centre-px", nargs=2, type=float, help="Spots: the image's centre in the file's coordinates.")
@click.option(
    "--image-size-px",
    nargs=2,
    type=click.FloatRange(min=1.0),
    help="Spots: width and height of the image, if they count from its corner.",
)
@click.option(
    "--first-pixel-px",
    type=click.Choice(["0", "0.5"]),
    help="Spots: coordinate of the first pixel's centre, with --image-size-px or --model.  [default: 0]",
)
@click.option(
    "--saturation", type=click.FloatRange(min=0.0, min_open=True), help="Picture: counts of a saturated pixel."
)
@click.option(
    "--threshold",
    type=click.FloatRange(min=2.0),
    default=5.0,
    show_default=True,
    help="Picture: least height of a star above the background, sigma.",
)
@click.option(
    "--electrons-per-count",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Picture: the camera's gain, for the noise of the stars' own light.",
)
@click.option("--residual-px", type=click.FloatRange(min=0.0, max=1e3), help=RESIDUAL + " Picture: noise as found.")
@click.option("--epoch", help="Julian year or ISO date (UTC) of the frame.")
@click.option(
    "--velocity-km-s", nargs=3, type=float, help="Observer's barycentric velocity, ICRS: corrects for aberration."
)
@click.option("--json", "json_path", type=OutputPath(), help="Write the solution as one JSON object.")
@click.option("--spots", "spots_path", type=OutputPath(), help="Picture: write the spots found, .csv or .parquet.")
@click.option("--wcs", type=OutputPath(), help="Write world coordinates as a FITS header (TAN, SIP), .fits.")
@click.option("--plot", type=OutputPath(), help="Draw spots and stars, over a picture if it is one, .png, .pdf, .svg.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(frame: Path, quiet: bool, **options: Any) -> None:
    """Find the inertial attitude of FRAME: a picture (PNG, TIFF, JPEG, FITS), or a CSV of spots.

    A CSV has columns x_px, y_px (from the image's centre, x right, y down) and flux or magnitude. Right ascension and
    declination are those of camera +z (for a model its optical axis, else the image's centre); roll is atan2(-A[0,2],
    A[1,2]) of dcm_cam_from_icrs. A frame without a credible attitude is not solved, and the reason is printed.
    """
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.epochs import julian_year
    from relnav.files.picture_style import check_picture

    written = [options[name] for name in ("json_path", "spots_path", "wcs", "plot")]
    for path in written:
        if path is not None:
            check_folder(path)
    check_distinct(frame, *written)
    if options["plot"] is not None:
        check_picture(options["plot"])
    epoch, velocity = options["epoch"], options["velocity_km_s"]
    year = None if epoch is None else julian_year(epoch)
    seen = _read(frame, options)
    from relnav.files.star_solving import solve_frame  # it loads the sensor

    solution = solve_frame(
        seen.frame,
        options["model"],
        options["focal_px"],
        year,
        velocity,
        focal_error=0.01 * options["focal_error"],
        mirrored=options["mirrored"],
    )
    head = {"frame": str(frame), "model": options["model"], "epoch_jyear": year, "velocity_km_s": velocity}
    with Outputs() as outputs:
        _write(seen, solution, head, options, outputs)
    if not quiet:
        say([*solution_lines(solution, len(seen.frame.spots_px)), *_elongated(seen, solution)], *written)


def _elongated(seen: "Seen", solution: "StarSolution") -> list[str]:
    """What most spots of a picture say of it where it was not solved."""
    if solution.ok or seen.found is None or 2 * seen.found.blended.sum() < len(seen.found.blended):
        return []
    return [
        f"{seen.found.blended.sum()} of {len(seen.found.blended)} spots are elongated: if the camera turned during the "
        "exposure, expose shorter"
    ]


def _read(path: Path, options: dict[str, Any]) -> "Seen":
    """The frame, after what was said of it was found to make sense."""
    from relnav.errors import UsageError
    from relnav.files.images import is_picture
    from relnav.files.star_pictures import see_picture, see_spots

    if options["velocity_km_s"] is not None and options["epoch"] is None:
        raise UsageError("--velocity-km-s needs --epoch as well: the velocity belongs to a time")
    of_spots = [name for name in ("centre_px", "image_size_px", "first_pixel_px") if options[name] is not None]
    if is_picture(path):
        if of_spots:
            raise UsageError(f"--{of_spots[0].replace('_', '-')} is for a CSV of spots; a picture has its own pixels")
        if options["wcs"] is not None:
            _check_wcs(options["wcs"])
        return see_picture(
            path,
            options["saturation"],
            options["threshold"],
            options["spots_path"],
            electrons_per_count=options["electrons_per_count"],
            residual_px=options["residual_px"],
        )
    of_picture = {"saturation": "--saturation", "electrons_per_count": "--electrons-per-count", "spots_path": "--spots"}
    for name, option in of_picture.items():
        if options[name] is not None:
            raise UsageError(f"{option} is for a picture; {path.name} is read as a CSV of spots")
    from relnav.files.star_solving import load_star_sensor, origin_of_spots

    model = None if options["model"] is None else load_star_sensor(options["model"])
    size = options["image_size_px"] or (None if model is None else model.camera.detector_size_px)
    if options["wcs"] is not None:
        if size is None:
            raise UsageError("--wcs needs the size of the picture: --image-size-px WIDTH HEIGHT, or --model")
        _check_wcs(options["wcs"])
    origin = origin_of_spots(model, options["centre_px"], options["image_size_px"], options["first_pixel_px"])
    return see_spots(path, origin, size, residual_px=options["residual_px"])


def _check_wcs(path: Path) -> None:
    """Refuse a header that cannot be written, before any work is done."""
    from relnav.errors import UsageError
    from relnav.files.atomic import is_stream
    from relnav.files.images import FITS_ENDINGS, require_astropy

    if path.suffix.lower() not in (*FITS_ENDINGS, ".wcs") and not is_stream(path):
        raise UsageError(f"{path}: a FITS header ends in .fits or .wcs; got '{path.suffix}'")
    require_astropy()


def _write(
    seen: "Seen", solution: "StarSolution", head: dict[str, Any], options: dict[str, Any], outputs: "Outputs"
) -> None:
    """What was asked for; world coordinates only of a frame that was solved."""
    from relnav.files.star_pictures import write_spots
    from relnav.files.star_solutions import draw_solution, solution_values
    from relnav.files.star_wcs import wcs_cards, write_wcs
    from relnav.files.tables import write_json

    spots = seen.frame.spots_px
    if options["json_path"] is not None:
        origin = {"mirrored": options["mirrored"], "centre_px": seen.origin_px.tolist()}
        write_json(solution_values(solution, spots) | head | origin, outputs.path(options["json_path"]))
    if options["spots_path"] is not None and seen.found is not None:
        write_spots(seen.found, outputs.path(options["spots_path"], ".csv"))
    if options["wcs"] is not None and solution.lens is not None and seen.size_px is not None:
        cards = wcs_cards(solution.lens, seen.size_px, options["velocity_km_s"], options["mirrored"])
        write_wcs(cards, outputs.path(options["wcs"], ".fits"))
    if options["plot"] is not None:
        title = f"{seen.frame.path.name}: {solution.status}, {matches_of(solution, len(spots))}"
        draw_solution(solution, seen, title, outputs.path(options["plot"], ".png"))


def matches_of(solution: "StarSolution", spots: int) -> str:
    """How many spots are stars, of those that took part."""
    from relnav.sensors.dual_field.frame_solver import MOST_SPOTS

    part = f"the {MOST_SPOTS} brightest of {spots}" if spots > MOST_SPOTS else f"{spots}"
    return f"{solution.matches} of {part} spots are stars"


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
        f"{matches_of(solution, spots)}{where}; focal length {solution.focal_length_px:.2f} px; "
        f"probability of chance below 1e{solution.log10_false_alarm:.0f}",
    ]
    return [*lines, solution.reason] if solution.reason else lines
