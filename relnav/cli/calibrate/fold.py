"""`relnav calibrate fold`: frames of a two-field star sensor in, its mirror's normal and how well it is known out."""

from pathlib import Path

import click

from relnav.cli.completion import STARS, ModelName
from relnav.cli.printing import InputPath, OutputPath, say


@click.command(
    epilog="Example: relnav calibrate fold frames.csv --model dual_field_star --velocity-km-s -10.2 25.3 11.0 "
    "--epoch 2026.5 --out fold.toml"
)
@click.argument("frames", type=InputPath())
@click.option(
    "--model",
    type=ModelName(*STARS),
    required=True,
    help="Two-field star sensor: a shipped name, a folder or a file.",
)
@click.option(
    "--velocity-km-s", nargs=3, type=float, required=True, help="Observer's barycentric velocity, ICRS (aberration)."
)
@click.option("--epoch", help="Julian year or ISO date (UTC); the model's own if left out.")
@click.option("--out", type=OutputPath(), help="The model's [fold] section as fitted, .toml.")
@click.option("--json", "json_path", type=OutputPath(), help="Write the figures as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(
    frames: Path,
    model: str,
    velocity_km_s: tuple[float, float, float],
    epoch: str | None,
    out: Path | None,
    json_path: Path | None,
    quiet: bool,
) -> None:
    """Fit the mirror's normal from FRAMES of the sky, a CSV of spots t_s, x_px, y_px and flux or magnitude.

    No prior of the mirror is needed. Each field of a frame is identified by itself, then the normal is fitted over all
    frames at once; a frame that contradicts the others is excluded and listed.
    """
    from relnav.errors import InputError, UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.attitude_log import read_star_log
    from relnav.files.epochs import julian_year
    from relnav.files.star_solving import load_star_sensor, origin_of_spots, velocity_option
    from relnav.files.tables import write_json
    from relnav.sensors.dual_field.fold_fit import fit_fold

    for path in (out, json_path):
        if path is not None:
            check_folder(path)
    check_distinct(frames, out, json_path)
    sensor = load_star_sensor(model)
    if sensor.fold.kind != "mirror":
        raise UsageError(f"{sensor.path}: [fold] kind is {sensor.fold.kind!r}; a mirror's normal is what is fitted")
    velocity = velocity_option("--velocity-km-s", velocity_km_s)
    images = read_star_log(frames, origin_of_spots(sensor))
    year = None if epoch is None else julian_year(epoch)
    try:
        fit = fit_fold(
            [(image.spots_px, image.flux, image.magnitude) for _, image in images], sensor, velocity, epoch_jyear=year
        )
    except ValueError as error:
        raise InputError(f"{frames}: {error}") from error
    figures = {"model": model, "frames": len(images), "used": len(fit.used), **fit.figures(sensor)}
    figures["left_out_t_s"] = [images[k][0] for k in fit.left_out]
    section = "\n".join(
        [
            "[fold]",
            'kind = "mirror"',
            f"mirror_normal = [{', '.join(repr(float(value)) for value in fit.estimate.normal)}]",
            f"error_arcsec = {figures['error_arcsec']:.3g}",
            f"transmission = {sensor.fold.transmission!r}",
            f"reflectance = {sensor.fold.reflectance!r}",
            "",
        ]
    )
    with Outputs() as outputs:
        if out is not None:
            outputs.path(out).write_text(section, encoding="utf-8")
        if json_path is not None:
            write_json(figures, outputs.path(json_path))
    if not quiet:
        sigma = figures["sigma_arcsec"]
        say(
            [
                f"{len(fit.used)} of {len(images)} frames show both fields",
                *(f"left out: the frame at t_s = {images[k][0]:g} contradicts the others" for k in fit.left_out),
                f"mirror {figures['off_model_arcsec']:.1f} arcsec from the model's; 1-sigma {sigma[0]:.2f} arcsec in "
                f"the plane of normal and boresight, {sigma[1]:.2f} out of it",
                section.rstrip("\n"),
            ],
            out,
            json_path,
        )
