"""`relnav budget`: what accuracy a design will reach, what limits it, and what a change buys."""

from pathlib import Path
from typing import Any

import click

from relnav.cli.completion import FLOWN, ModelName
from relnav.cli.printing import OutputPath, say


@click.command(epilog="Example: relnav budget three_beacon_psd --set focal_length_mm=80 --plot budget.png")
@click.argument("model", type=ModelName(*FLOWN))
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Replace a value of MODEL; as often as you like.",
)
@click.option("--json", "json_path", type=OutputPath(), help="Write the budget as one JSON object.")
@click.option("--plot", type=OutputPath(), help="Draw the budget by range, .png, .pdf or .svg.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(model: str, settings: tuple[str, ...], json_path: Path | None, plot: Path | None, quiet: bool) -> None:
    """Error budget of MODEL by analysis: what each source of error costs, by range.

    Keys of --set are those of the model's file, in any fitting unit: focal_length_mm=80, or sensor.focal_length_mm=80.
    """
    from relnav.cli.settings import setting
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.models import load_model
    from relnav.files.picture_style import check_picture
    from relnav.files.systems import resolve, system_of
    from relnav.files.tables import write_json

    for path in (json_path, plot):
        if path is not None:
            check_folder(path)
    if plot is not None:
        check_picture(plot)
    check_distinct(json_path, plot)
    changes, change = dict(setting(text) for text in settings), " ".join(settings)
    mission = load_model(model, changes)
    system = system_of(mission)
    if not system.budget:
        raise UsageError(f"{mission.name}: no error budget is known for this kind of sensor")
    if plot is not None:
        from relnav.files.budget_picture import check_drawable

        check_drawable(mission)
    budget = resolve(system.budget)
    try:
        report = budget(mission)
        before = budget(load_model(model)) if changes else None
    except ValueError as error:
        raise UsageError(str(error)) from error
    except OverflowError as error:
        raise UsageError(
            f"{mission.name}: a value is too large or too small for a budget: {change or model}"
        ) from error
    with Outputs() as outputs:
        if json_path is not None:
            figures = report.to_dict() | {"change": change, "before": None if before is None else before.to_dict()}
            write_json(figures, outputs.path(json_path))
        if plot is not None:
            from relnav.files.budget_picture import draw_budget

            draw_budget(report, outputs.path(plot, ".png"), before, change)
    if not quiet:
        changed = [] if before is None else _change_lines(report, before, change)
        say([*report.lines(), *changed], json_path, plot)


def _change_lines(report: Any, before: Any, change: str) -> list[str]:
    if hasattr(report, "change_lines"):
        lines: list[str] = report.change_lines(before, change)
        return lines
    return [f"before {change}:", *before.lines()]
