"""What a call was given: values that replace those of a file (`--set KEY=VALUE`), and which of its options."""

from collections.abc import Iterator
from typing import Any

import click


def given_options() -> Iterator[tuple[str, str]]:
    """Each parameter that stands on the command line, not by default: its name, and how it is written."""
    context = click.get_current_context()
    for parameter in context.command.params:
        name = parameter.name or ""
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            yield name, parameter.opts[0]


def setting(text: str) -> tuple[str, Any]:
    """Key and value of KEY=VALUE; the value is written as in a model's file, words need no quotes."""
    import tomllib

    from relnav.errors import UsageError

    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise UsageError(f"--set is written KEY=VALUE, as in focal_length_mm=80; got {text!r}")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()


def model_and_scenario(settings: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Changes of the model and of the scenario: a key is a scenario's where a section of one has it."""
    from relnav.files.scenarios import is_of_scenario

    changes = dict(setting(text) for text in settings)
    of_scenario = {key: value for key, value in changes.items() if is_of_scenario(key)}
    return {key: value for key, value in changes.items() if key not in of_scenario}, of_scenario
