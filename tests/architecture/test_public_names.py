"""The public names: each is where it is said to be, is what it is called, and says what it does."""

import inspect
import re
import shutil
import types
from collections import Counter

import pytest

import relnav


def test_at_most_thirty_eight_names():
    assert len(relnav.__all__) <= 38


@pytest.mark.parametrize("name", relnav.__all__)
def test_each_resolves_to_itself_and_has_a_docstring(name):
    value = getattr(relnav, name)
    if isinstance(value, types.ModuleType):
        assert value.__name__ == f"{relnav._HOME[name]}.{name}"
    else:
        assert callable(value), f"{name} is {value!r}"
        assert value.__name__ == name
        assert value.__module__ == relnav._HOME[name]
    own = value.__dict__.get("__doc__") if isinstance(value, type) else value.__doc__
    assert own, f"{name} has no docstring of its own"
    assert not own.startswith(f"{name}("), f"{name} has the docstring that dataclass made up"
    assert inspect.getdoc(value).split("\n")[0].rstrip().endswith((".", ")"))


def test_first_use_in_any_order(python):
    """Names resolve from a fresh interpreter, last first: none needs another to have been used before."""
    done = python("import relnav\nfor name in reversed(relnav.__all__): assert getattr(relnav, name) is not None")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", relnav.__all__)
def test_a_name_is_right_when_it_is_the_first(python, name):
    """Importing `relnav.files.filter_log` must not put the module in the function's place."""
    value = getattr(relnav, name)
    kind = "module" if isinstance(value, types.ModuleType) else "type" if isinstance(value, type) else "function"
    code = f"import relnav; value = relnav.{name}; assert type(value).__name__ in ({kind!r}, 'EnumType'), type(value)"
    environment = {"RELNAV_JIT": "0"}  # a faster start
    done = python(code, environment=environment)
    assert done.returncode == 0, done.stderr


def test_dir_lists_them():
    assert set(relnav.__all__) <= set(dir(relnav))


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'relnav' has no attribute 'filter_logs'"):
        _ = relnav.filter_logs


def test_a_name_is_written_once(root):
    """As one line `from HOME import NAME as NAME`, which is all that a type checker takes for public."""
    text = (root / "relnav" / "__init__.py").read_text()
    lines = re.findall(r"^    from (\S+) import (\w+) as (\w+)$", text, re.MULTILINE)
    assert {name: home for home, name, _ in lines} == relnav._HOME
    assert [name for _, name, public in lines if name != public] == []
    assert [name for name, count in Counter(name for _, name, _ in lines).items() if count > 1] == []
    assert [name for name in relnav.__all__ if f'"{name}"' in text] == []


def test_a_name_without_a_home_is_told(python, root, tmp_path):
    """A name that is stated but does not exist: found by mypy, and by the tests above, which use every name."""
    shutil.copytree(root / "relnav", tmp_path / "relnav", ignore=shutil.ignore_patterns("__pycache__"))
    file = tmp_path / "relnav" / "__init__.py"
    line = "    from relnav.mission import Model as Model\n"
    file.write_text(file.read_text().replace(line, line + line.replace("Model", "Modell")))
    done = python("import relnav; assert 'Modell' in relnav.__all__; relnav.Modell", path=tmp_path, cwd=tmp_path)
    assert "module 'relnav.mission' has no attribute 'Modell'" in done.stderr


def test_errors_are_value_errors():
    """One `except ValueError` catches what a user can do wrong."""
    for name in ("InputError", "LogError", "ModelError", "UsageError"):
        assert issubclass(getattr(relnav, name), ValueError)
    assert issubclass(relnav.LogError, relnav.InputError)
    assert issubclass(relnav.ModelError, relnav.InputError)
