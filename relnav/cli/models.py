"""`relnav models`: which models there are, and where each value of one comes from."""

from pathlib import Path
from typing import Any

import click


def _show(name: str) -> dict[str, Any]:
    from relnav.files.models import find_model, load_model, load_published
    from relnav.files.toml_values import read_toml

    model = load_model(name)
    table, _ = read_toml(find_model(name))
    values = {
        f"{section}.{key}": raw["value"] if isinstance(raw, dict) else raw
        for section, entries in table.items()
        if isinstance(entries, dict)
        for key, raw in entries.items()
    }
    return {
        "name": model.name,
        "title": model.title,
        "values": {
            key: {"value": value, "source": model.provenance.get(key, "unstated")} for key, value in values.items()
        },
        "published": [vars(claim) for claim in load_published(name).claims],
    }


@click.command(epilog="Example: relnav models three_beacon_psd")
@click.argument("name", required=False)
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="Write the same as one JSON object.")
@click.option("--quiet", is_flag=True, help="Print nothing.")
def command(name: str | None, json_path: Path | None, quiet: bool) -> None:
    """List the shipped models, or show the model NAME (a shipped name, a folder or a file) with its sources."""
    from relnav.files.models import list_models, load_model
    from relnav.files.tables import write_json

    if name is None:
        result: dict[str, Any] = {"models": {entry: load_model(entry).title for entry in list_models()}}
        if not quiet:
            width = max(map(len, result["models"]))
            for entry, title in result["models"].items():
                click.echo(f"{entry:<{width}}  {title}")
    else:
        result = _show(name)
        if not quiet:
            click.echo(f"{result['name']}: {result['title']}")
            width = max(map(len, result["values"]))
            for key, entry in result["values"].items():
                click.echo(f"  {key:<{width}} = {entry['value']}\n  {'':<{width}}   {entry['source']}")
            for claim in result["published"]:
                click.echo(
                    f"  published {claim['quantity']}: {claim['value']} {claim['unit']} "
                    f"({claim['statistic']} statistic, {claim['condition']}; {claim['page']}); "
                    f"expected {claim['expected']}: {claim['reason']}"
                )
    if json_path is not None:
        write_json(result, json_path)
