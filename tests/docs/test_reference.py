"""The API reference says what users hold: every class that calls return, every attribute, its shape and its unit."""

import dataclasses
import importlib.util
import inspect
import re
import sys
import typing
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from relnav.files.systems import SYSTEMS, resolve

pytest.importorskip("sphinx", reason="sphinx is not installed")

DOCS = Path(__file__).parents[2] / "docs"
SHAPE = re.compile(r"\((?:\.\.\. *, *)?(?:\w+|\w+ [a-z]+|\w+ [+*-] \w+)(?:, *[\w +*-]+)*,?\)")
"""(n,), (3, 3), (..., 2), (n, 2 beacons), (nx + 1, ny + 1, 2)."""
UNIT = re.compile(
    r"(?:_|\b)(?:m|mm|um|km|s|us|rad|deg|arcsec|px2?|hz|Hz|kg|w|W|a|A|v|V|ohm|mas|mag|jyear|[Ee]lectrons?|photons?|counts?"
    r"|m_s2?|rad_s|[Ss]igmas?|[Ss]hare|[Rr]atio|[Pp]robability|NEES|NIS|[Cc]osines?|[Ff]actors?|log10|[Cc]hi-square"
    r"|[Mm]agnitude|[Rr]elative|[Oo]dds|SI|SI units|claim's unit|same unit)(?:_|\b)|in `unit`|chi2"
)
"""A unit in a name or in words, or a word for what has none."""
MODELS = {base for system in SYSTEMS.values() for base in resolve(system.mission).__mro__}
"""What model files become: their sections have a page of keys of their own."""

sys.path.insert(0, str(DOCS / "_ext"))
spec = importlib.util.spec_from_file_location("generated", DOCS / "_ext" / "generated.py")
generated = importlib.util.module_from_spec(spec)
spec.loader.exec_module(generated)
CLASSES = [
    value
    for value in {id(v): v for v in [*generated.public().values(), *generated.returned()]}.values()
    if isinstance(value, type) and not issubclass(value, Exception)
]


def described(cls):
    """{attribute: what the section `Attributes` of the class or of one that it derives from says, type included}."""
    said = {}
    for base in reversed(cls.__mro__):
        doc = base.__dict__.get("__doc__") or ""
        section = inspect.cleandoc(doc).partition("Attributes\n----------\n")[2]
        entry = []
        for line in section.splitlines():
            if line and not line.startswith(" "):
                if re.fullmatch(r"-+", line):
                    break
                names, _, kind = line.partition(" : ")
                entry = [name.strip() for name in names.split(",")]
                said |= dict.fromkeys(entry, kind)
            elif line.strip():
                for name in entry:
                    said[name] += " " + line.strip()
    for name, value in vars(cls).items():
        if isinstance(value, property | cached_property) and not name.startswith("_"):
            said[name] = inspect.getdoc(value) or ""
    return said


def kinds(cls):
    """{attribute: "array" or "float" or ""} of the fields and properties that users read."""
    hints = dict(typing.get_type_hints(cls)) if dataclasses.is_dataclass(cls) else {}
    for name, value in vars(cls).items():
        if isinstance(value, property | cached_property):
            call = value.fget if isinstance(value, property) else value.func
            hints[name] = typing.get_type_hints(call).get("return")
    found = {}
    for name, hint in hints.items():
        if name.startswith("_"):
            continue
        parts = [hint, *typing.get_args(hint)]
        array = any(getattr(part, "__origin__", None) is np.ndarray for part in parts)
        found[name] = "array" if array else "float" if float in parts else ""
    return found


def problems(cls):
    said = described(cls)
    for name, kind in kinds(cls).items():
        text = said.get(name, "")
        if not text and cls not in MODELS:
            yield f"{cls.__name__}.{name} is not described"
        elif kind == "array" and not SHAPE.search(text):
            yield f"{cls.__name__}.{name} names no shape: {text}"
        elif kind == "float" and not UNIT.search(f"{name} {text}"):
            yield f"{cls.__name__}.{name} names no unit: {text}"


def test_what_calls_return_is_found():
    """Some that users hold and cannot import from relnav; models' sections have their own page."""
    found = {cls.__name__ for cls in generated.returned()}
    assert found >= {
        "AttitudeRecord", "Hypothesis", "Observed", "PoseRecord", "PoseSolution", "Published", "SimulatedLog",
        "VehicleEstimate", "ImpliedPose", "Row",
    }  # fmt: skip
    assert not found & {"Model", "Camera", "Docking", "Detector"}


def test_what_is_not_said_is_found():
    @dataclasses.dataclass
    class Said:
        """One.

        Attributes
        ----------
        place_m : (3,)
            Where.
        speed : float
            How fast.
        """

        place_m: np.ndarray[typing.Any, np.dtype[np.float64]]
        speed: float
        left_out: int

    assert [text.split(":")[0] for text in problems(Said)] == [
        f"{Said.__name__}.speed names no unit",
        "Said.left_out is not described",
    ]
    Said.__doc__ = Said.__doc__.replace("(3,)", "array").replace("How fast.", "How fast, m/s.")
    assert "names no shape" in next(problems(Said))


@pytest.mark.parametrize("cls", CLASSES, ids=lambda cls: cls.__name__)
def test_every_attribute_is_described_with_shape_and_unit(cls):
    assert list(problems(cls)) == []
