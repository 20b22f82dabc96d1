"""What the shell offers for a parameter, when it completes a command line (docs/start.md)."""

import click
from click.shell_completion import CompletionItem


class ModelName(click.types.StringParamType):
    """A shipped model, a folder or a file: the shell offers the shipped ones of these kinds, all without kinds."""

    def __init__(self, *kinds: str) -> None:
        """`kinds`: sensor_type of a model."""
        self._kinds = kinds

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:  # noqa: ARG002  (click's signature)
        """Names that begin so; where there is none, files."""
        from relnav.files.model_folders import list_models, sensor_type

        names = [name for name in list_models() if name.startswith(incomplete)]
        found = [CompletionItem(name) for name in names if not self._kinds or sensor_type(name) in self._kinds]
        return found or [CompletionItem(incomplete, type="file")]


FLOWN = "three_beacon", "three_marker", "vehicle"
STARS = ("dual_field",)
SUN = "aps_sun", "birefringent_sun"
"""Kinds of models that a command takes."""
