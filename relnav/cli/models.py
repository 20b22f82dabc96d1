"""`relnav models`: which models there are, and where each value of one comes from."""

from pathlib import Path
from typing import Any

import click

from relnav.cli.completion import ModelName
from relnav.cli.printing import OutputPath, say


def _show(name: str) -> dict[str, Any]:
    from relnav.files.models import load_model, load_published, model_values

    model = load_model(name)
    return {
        "name": model.name,
        "title": model.title,
        "values": model_values(model),
        "published": [vars(claim) for claim in load_published(name).claims],
    }


@click.command(epilog="Example: relnav models three_beacon_psd, or relnav models three_beacon_psd --copy my.toml")
@click.argument("name", required=False, type=ModelName())
@click.option("--copy", type=OutputPath(), help="Write the model's file, .toml, as a start for one of your own.")
@click.option(
    "--schema",
    type=OutputPath(),
    help="Write the JSON schema of such files, .json: an editor completes the keys of a file that begins with "
    "`#:schema FILE`.",
)
@click.option("--json", "json_path", type=OutputPath(), help="Write the same as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(name: str | None, copy: Path | None, schema: Path | None, json_path: Path | None, quiet: bool) -> None:
    """List the shipped models, or show the model NAME (a shipped name, a folder or a file) with its sources."""
    from relnav.errors import UsageError
    from relnav.files.atomic import Outputs, check_distinct, check_folder
    from relnav.files.model_folders import find_model, shipped_titles

    for path in (copy, schema, json_path):
        if path is not None:
            check_folder(path)
    check_distinct(copy, schema, json_path, None if name is None else find_model(name))
    if name is None and (copy is not None or schema is not None):
        raise UsageError("--copy and --schema need the NAME of a model; `relnav models` lists them")
    if name is None:
        result: dict[str, Any] = {"models": shipped_titles()}
        width = max(map(len, result["models"]))
        lines = [f"{entry:<{width}}  {title}" for entry, title in result["models"].items()]
    else:
        result = _show(name)
        lines = _lines(result)
    with Outputs() as outputs:
        if json_path is not None:
            from relnav.files.tables import write_json

            write_json(result, outputs.path(json_path))
        if copy is not None and name is not None:
            outputs.path(copy).write_bytes(find_model(name).read_bytes())
            lines = [f"model: {copy} (a copy of {result['name']}; use it as --model {copy})"]
        if schema is not None and name is not None:
            from relnav.files.model_schema import model_schema
            from relnav.files.models import load_model
            from relnav.files.tables import write_json

            write_json(model_schema(load_model(name)), outputs.path(schema))
            said = f"schema: {schema} (put '#:schema {schema}' at the top of a model file; editors with Taplo read it)"
            lines = [*(lines if copy is not None else []), said]
    if not quiet:
        say(lines, copy, schema, json_path)


def _lines(model: dict[str, Any]) -> list[str]:
    """A model for a reader."""
    lines = [f"{model['name']}: {model['title']}"]
    width = max(map(len, model["values"]), default=0)
    for key, entry in model["values"].items():
        lines += [f"  {key:<{width}} = {entry['value']}", f"  {'':<{width}}   {entry['source']}"]
    lines += [
        f"  published {claim['quantity']}: {claim['value']} {claim['unit']} "
        f"({claim['statistic']} statistic, {claim['condition']}; {claim['page']}); "
        f"expected {claim['expected']}: {claim['reason']}"
        for claim in model["published"]
    ]
    return lines
