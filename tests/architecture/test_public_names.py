"""The public names: each is where it is said to be, is what it is called, and says what it does."""

import inspect
import types

import pytest

import relnav


def test_all_is_what_has_a_home():
    assert relnav.__all__ == sorted(relnav._HOME)


def test_about_twenty_names():
    assert len(relnav.__all__) <= 30


@pytest.mark.parametrize("name", relnav.__all__)
def test_each_resolves_to_itself_and_has_a_docstring(name):
    value = getattr(relnav, name)
    if name in relnav._MODULES:
        assert isinstance(value, types.ModuleType)
        assert value.__name__ == f"relnav.sensors.{name}"
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
    kind = "module" if name in relnav._MODULES else "type" if isinstance(getattr(relnav, name), type) else "function"
    code = f"import relnav; value = relnav.{name}; assert type(value).__name__ in ({kind!r}, 'EnumType'), type(value)"
    environment = {"RELNAV_JIT": "0"}  # a faster start
    done = python(code, environment=environment)
    assert done.returncode == 0, done.stderr


def test_dir_lists_them():
    assert set(relnav.__all__) <= set(dir(relnav))


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'relnav' has no attribute 'filter_logs'"):
        _ = relnav.filter_logs


def test_the_type_checkers_block_is_the_same_list(root):
    """The names under TYPE_CHECKING, which a reader and mypy see, come from the same homes."""
    import ast

    tree = ast.parse((root / "relnav" / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    stated = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom)
        for alias in node.names:
            whole = f"{node.module}.{alias.name}"
            stated[alias.name] = whole if whole == relnav._HOME.get(alias.name) else node.module
    assert stated == relnav._HOME


def test_errors_are_value_errors():
    """One `except ValueError` catches what a user can do wrong."""
    for name in ("InputError", "LogError", "ModelError", "UsageError"):
        assert issubclass(getattr(relnav, name), ValueError)
    assert issubclass(relnav.LogError, relnav.InputError)
    assert issubclass(relnav.ModelError, relnav.InputError)
