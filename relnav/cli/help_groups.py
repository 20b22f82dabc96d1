"""Options of a command in groups: `--help` lists each group under its own name."""

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])


class GroupedOption(click.Option):
    """An option that belongs to a group."""

    def __init__(self, *args: Any, group: str, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.group = group


class GroupedCommand(click.Command):
    """A command whose options are listed by their groups, in the order in which these appear."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List them; options without a group come last."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record is not None:
                groups.setdefault(getattr(parameter, "group", "Other"), []).append(record)
        for name, records in groups.items():
            with formatter.section(name):
                formatter.write_dl(records)


class OptionsOf:
    """`click.option` for the options of a group."""

    def __init__(self, group: str) -> None:
        self._group = group

    def __call__(self, *names: str, **settings: Any) -> Callable[[F], F]:
        """A decorator, as `click.option` gives it."""
        return click.option(*names, cls=GroupedOption, group=self._group, **settings)
