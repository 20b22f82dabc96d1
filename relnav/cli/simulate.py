"""`relnav simulate`: an approach flown on integrated orbits, as a log to filter and its truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from relnav.cli.completion import ModelName
from relnav.cli.help_groups import GroupedCommand, OptionsOf
from relnav.cli.printing import OutputPath, say

if TYPE_CHECKING:
    from relnav.cli.simulators import Options, Simulated
    from relnav.simulation.trajectory import Approach


_output, _flight, _images, _scenario = map(OptionsOf, ("Output", "Flight", "Images and faults", "Scenario and model"))


@click.command(
    cls=GroupedCommand,
    epilog="Example: relnav simulate three_beacon_psd --out log.csv --truth truth.csv --seed 7",
)
@click.argument("model", type=ModelName())
@_output("--out", required=True, type=OutputPath(), help="Log to write, .csv or .parquet.")
@_output("--truth", type=OutputPath(), help="True states to write, .csv or .parquet.")
@_flight("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="The same seed, the same log.")
@_flight("--duration", "duration_s", default=300.0, show_default=True, help="Duration, s.")
@_flight("--rate", "rate_hz", default=10.0, show_default=True, help="Images a second.")
@_images("--dropout", default=0.0, show_default=True, help="Probability that a spot is not seen.")
@_images("--outliers", default=0.0, show_default=True, help="Probability that a spot is a glint elsewhere.")
@_flight("--start-range", "start_range_m", default=10.0, show_default=True, help="Start on the docking axis, m.")
@_flight("--final-range", "final_range_m", default=4.0, show_default=True, help="Range at which the chaser holds, m.")
@_flight("--speed", "speed_m_s", default=0.03, show_default=True, help="Approach speed, m/s.")
@_images(
    "--hide",
    "hidden",
    multiple=True,
    metavar="MARKER:FROM:TO",
    help="Marker models: hide one for a while, as in c:30:60 (s); as often as needed.",
)
@_flight("--j2", is_flag=True, help="Include the Earth's oblateness (J2).")
@_flight("--air-density", "air_density_kg_m3", default=0.0, show_default=True, help="Air density for drag, kg/m^3.")
@_images("--received-power", is_flag=True, help="Spot noise by received power, with its 1-sigma as columns of the log.")
@_images("--raw", is_flag=True, help="Write converter counts, a row a slot, by the model's [detector] and [pulses].")
@_images(
    "--as-built",
    is_flag=True,
    help="Draw focal length, mountings, beacons or markers within the model's [tolerances] (by --seed).",
)
@_scenario("--scenario", "scenario_path", type=click.Path(path_type=Path), help="Fly a run of a scenario file instead.")
@_scenario("--run", type=click.IntRange(min=0), help="Run of the scenario; the first if left out.")
@_scenario(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace a value of MODEL, or of the scenario (approach.speed_mm_s=20); as often as you like.",
)
@_images("--distortion", "distortion_um", default=0.0, help="With --raw: largest detection error, um.")
@_output("--quiet", is_flag=True, help="Print nothing.")
def command(
    model: str,
    out: Path,
    truth: Path | None,
    seed: int,
    duration_s: float,
    rate_hz: float,
    dropout: float,
    outliers: float,
    start_range_m: float,
    final_range_m: float,
    speed_m_s: float,
    hidden: tuple[str, ...],
    j2: bool,
    air_density_kg_m3: float,
    received_power: bool,
    raw: bool,
    as_built: bool,
    scenario_path: Path | None,
    run: int | None,
    settings: tuple[str, ...],
    distortion_um: float,
    quiet: bool,
) -> None:
    """Simulate an approach of MODEL: two-body truth under closed-loop guidance, imaged with noise and faults.

    For a vehicle: from its hand-over to --final-range (1 m), with all its sensors; of the other options --seed and
    --truth apply. For a rotating star sensor, or a sun sensor with a moving sun, a log of its spots; if --out is a
    picture (.png, .tif, .fits), one exposure.

    With --scenario, or a --set of one of its keys, it is a run of a campaign: same seed, same run, same log. The
    options of approach and faults then have no effect, as the scenario states them (docs/campaign.md).
    """
    from relnav.cli.settings import model_and_scenario
    from relnav.cli.simulators import Options, simulated_run
    from relnav.cli.vehicle import refuse_others, simulate_vehicle
    from relnav.errors import InputError, UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.images import check_picture_to_write, is_picture
    from relnav.files.models import load_model
    from relnav.files.scenarios import load_scenario
    from relnav.files.tables import check_format
    from relnav.simulation.trajectory import Approach
    from relnav.spacecraft import Vehicle

    for path in (out, truth):
        if path is not None:
            check_picture_to_write(path) if path is out and is_picture(path) else check_format(path)
            check_folder(path)
    check_distinct(out, truth)
    of_model, of_scenario = model_and_scenario(settings)
    mission = load_model(model, of_model)
    described = scenario_path is not None or bool(of_scenario)
    if isinstance(mission, Vehicle) and not described and run is None:
        refuse_others()
        final = final_range_m if _is_given("final_range_m") else None
        return simulate_vehicle(mission, out, truth, seed, final, quiet=quiet)
    if run is not None and not described:
        raise UsageError("--run is the run of a scenario; without --scenario there is one flight a --seed")
    try:
        if described:
            _refuse_others(click.get_current_context())
            check_format(out)
            simulated = simulated_run(mission, load_scenario(scenario_path, of_scenario, model=mission), seed, run or 0)
        else:
            approach = Approach(
                duration_s=duration_s,
                rate_hz=rate_hz,
                start_m=(start_range_m, 0.25, -0.15),
                final_range_m=final_range_m,
                speed_m_s=speed_m_s,
                j2=j2,
                air_density_kg_m3=air_density_kg_m3,
            )
            options = Options(dropout, outliers, hidden, received_power, raw, as_built, distortion_um * 1e-6, seed)
            simulated = _one_flight(mission, approach, options, out)
    except InputError:
        raise
    except ValueError as error:
        raise UsageError(str(error)) from error
    metadata = {"model": mission.name, "seed": str(seed)} | ({"run": str(run or 0)} if described else {})
    with Outputs() as outputs:
        simulated.write_log(outputs.path(out, ".csv"), metadata)
        if truth is not None:
            simulated.write_truth(outputs.path(truth, ".csv"), metadata)
    if not quiet:
        log = f"log: {out} ({simulated.epochs} {simulated.rows}, model {mission.name}, seed {seed})"
        say([log, *([f"truth: {truth}"] if truth is not None else [])], out, truth)


def _one_flight(mission: Any, approach: "Approach", options: "Options", out: Path) -> "Simulated":
    """A flight of a mission, or what an instrument by itself sees."""
    from relnav.cli.instrument_simulators import INSTRUMENTS, simulate_instrument
    from relnav.cli.simulators import simulator_of
    from relnav.files.tables import check_format

    if isinstance(mission, INSTRUMENTS):
        return simulate_instrument(mission, approach, options, out)
    check_format(out)
    return simulator_of(mission)(mission, approach, options)


def _is_given(option: str) -> bool:
    """Whether an option was said, and does not stand at its default."""
    return click.get_current_context().get_parameter_source(option) is click.core.ParameterSource.COMMANDLINE


OF_A_SCENARIO = {"model", "out", "truth", "seed", "scenario_path", "run", "settings", "quiet"}


def _refuse_others(context: click.Context) -> None:
    """Refuse options that a scenario would silently replace."""
    from click.core import ParameterSource

    from relnav.errors import UsageError

    for parameter in context.command.params:
        name = parameter.name or ""
        if name not in OF_A_SCENARIO and context.get_parameter_source(name) == ParameterSource.COMMANDLINE:
            option = parameter.opts[0]
            raise UsageError(f"{option} is not for a scenario, which says it itself: use --set SECTION.KEY=VALUE")
