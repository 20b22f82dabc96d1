"""`relnav sun measure`: a sun sensor's picture or log of spots in, directions with covariance out."""

from pathlib import Path

import click

from relnav.cli.completion import SUN, ModelName
from relnav.cli.printing import InputPath, OutputPath, say


@click.command(
    epilog="Example: relnav sun measure spots.csv --model aps_sun --calibration sun.json --out directions.csv"
)
@click.argument("seen", type=InputPath())
@click.option(
    "--model",
    type=ModelName(*SUN),
    required=True,
    help="Sun sensor: aps_sun, birefringent_sun, a folder or a file.",
)
@click.option("--calibration", type=InputPath(), help="Of an APS sensor, from `relnav calibrate sun`, .json.")
@click.option(
    "--corner-px", nargs=2, type=float, help="Picture of a window: detector coordinates x y of its first pixel."
)
@click.option(
    "--first-pixel-px",
    type=click.Choice(["0", "0.5"]),
    help="Log: coordinate of the centre of the detector's first pixel.  [default: 0]",
)
@click.option("--out", type=OutputPath(), help="A row an image: angles, direction, covariance, .csv or .parquet.")
@click.option("--json", "json_path", type=OutputPath(), help="Write the same as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    seen: Path,
    model: str,
    calibration: Path | None,
    corner_px: tuple[float, float] | None,
    first_pixel_px: str | None,
    out: Path | None,
    json_path: Path | None,
    quiet: bool,
) -> None:
    """Measure the sun's direction from SEEN: a picture (PNG, TIFF, JPEG, FITS), or a CSV of spots, one row an image.

    A CSV has columns spot_x_px, spot_y_px, or for a birefringent sensor spot_a_x_px, spot_a_y_px, spot_b_x_px,
    spot_b_y_px, in any order of the two; and t_s if there are times. An empty spot is one that was not seen.
    Directions are in sensor axes, tan(alpha) = x/z and tan(beta) = y/z, z the boresight.
    """
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.sun_calibration import load_sun_calibration
    from relnav.files.sun_logs import direction_values, outcome_lines, write_directions
    from relnav.files.sun_measuring import load_sun_sensor, measure_sun
    from relnav.files.tables import check_format, write_json

    for path in (out, json_path):
        if path is not None:
            check_folder(path)
    if out is not None:
        check_format(out)
    check_distinct(seen, calibration, out, json_path)
    sensor = load_sun_sensor(model)
    used = None if calibration is None else load_sun_calibration(calibration)
    found, t_s = measure_sun(seen, sensor, calibration=used, corner_px=corner_px, first_pixel_px=first_pixel_px)
    with Outputs() as outputs:
        if out is not None:
            write_directions(found, t_s, sensor.name, outputs.path(out, ".csv"))
        if json_path is not None:
            rows = [direction_values(sun) for sun in found]
            times = rows if t_s is None else [{"t_s": t, **row} for t, row in zip(t_s.tolist(), rows, strict=True)]
            write_json({"seen": str(seen), "model": model, "measurements": times}, outputs.path(json_path))
    if not quiet:
        say(outcome_lines(found), out, json_path)
