"""What a caller may hand over as numbers: missing values become NaN, and nothing is dropped without a word."""

import datetime
import decimal
import math

import numpy as np
import pytest

from relnav.arrays import number, numbers, of_floats, one_piece


class NAType:
    """Stands for the class of pandas' NA, which is told by its name so that pandas need not be there."""


MASKED_ROW = np.ma.array([1.0, -9999.0], mask=[False, True])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (MASKED_ROW, [1.0, math.nan]),
        (np.ma.array([1, 7], mask=[True, False]), [math.nan, 7.0]),
        ([MASKED_ROW, [5.0, 6.0]], [[1.0, math.nan], [5.0, 6.0]]),
        ([[np.ma.masked, 1.0], [2.0, 3.0]], [[math.nan, 1.0], [2.0, 3.0]]),
        (np.ma.array([None, 3.0], mask=[False, True], dtype=object), [math.nan, math.nan]),
        (np.ma.array([1.0, 2.0]), [1.0, 2.0]),
        ([[None, 1.0], [2.0, 3]], [[math.nan, 1.0], [2.0, 3.0]]),
        ([decimal.Decimal("1.5"), 2], [1.5, 2.0]),
        (np.array([1.5, 2.0], dtype=">f4"), [1.5, 2.0]),
        (10**25, 1e25),
        ([], []),
    ],
)
def test_missing_values_are_nan_and_numbers_are_kept(value, expected):
    np.testing.assert_array_equal(numbers("x", value), expected)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ([1.0, 1j], "complex numbers"),
        (np.array([1j], dtype=object), "got a complex among them"),
        (np.array([np.complex128(1j)], dtype=object), "complex numbers"),
        (np.array(["2026-01-01"], dtype="datetime64[ns]"), r"dates \(datetime64\): give seconds"),
        (np.array([5], dtype="timedelta64[ns]"), r"spans of time \(timedelta64\): give seconds"),
        (np.array([np.timedelta64(5, "s"), 1.0], dtype=object), "spans of time"),
        ([datetime.datetime(2026, 1, 1)], "got a datetime among them"),
        ([datetime.timedelta(1)], "got a timedelta among them"),
        (["1.0"], "text"),
        (np.zeros(2, dtype=[("x", float)]), "records with fields"),
        ([10**400], "beyond the largest float"),
        ([[1.0, 2.0], [3.0]], "rows of one length"),
        ([object()], "got a object among them"),
        ([[NAType(), 1.0]], "got NA of pandas: give NaN"),
    ],
)
def test_what_is_not_real_numbers_is_refused_by_name(value, said):
    with pytest.raises(ValueError, match=f"spots_px holds .*{said}"):
        numbers("spots_px", value)


def test_pandas_missing_values():
    pandas = pytest.importorskip("pandas", reason="pandas, whose NA is tried, is not installed")
    table = pandas.DataFrame(
        {"x": pandas.array([1.5, None], dtype="Float64"), "y": pandas.array([1, 2], dtype="Int64")}
    )
    np.testing.assert_array_equal(numbers("x", table), [[1.5, 1.0], [math.nan, 2.0]])
    np.testing.assert_array_equal(numbers("x", table["x"]), [1.5, math.nan])
    with pytest.raises(ValueError, match="got NA of pandas: give NaN for what was not seen"):
        numbers("x", [pandas.NA, 1.0])
    with pytest.raises(ValueError, match="dates"):
        numbers("x", pandas.date_range("2026-01-01", periods=2))


def test_an_array_of_floats_is_not_copied_and_a_mask_does_not_change_its_owner():
    given = np.array([1.0, 2.0])
    assert numbers("x", given) is given
    hidden = np.ma.array([1.0, 2.0], mask=[True, False])
    numbers("x", hidden)
    np.testing.assert_array_equal(hidden.data, [1.0, 2.0])


def test_one_number():
    assert number("t_s", np.float32(2.0)) == 2.0
    assert math.isnan(number("t_s", np.ma.masked))
    for value in (np.datetime64("2026-01-01", "ns"), np.timedelta64(5, "ns"), 1j, "5", 10**400, [1.0]):
        with pytest.raises(ValueError, match="t_s"):
            number("t_s", value)


def test_compiled_code_gets_one_kind_of_array():
    given = np.arange(6.0).reshape(3, 2)
    assert one_piece("x", given) is given
    fixed = given.copy()
    fixed.setflags(write=False)
    for other in (given.T, given[:, ::-1], fixed):
        made = one_piece("x", other)
        assert made.flags.c_contiguous
        assert made.flags.writeable
        np.testing.assert_array_equal(made, other)


@pytest.mark.parametrize("value", [[1.0, -2.0, math.nan], (0.5,), [[1.0, 2.0], (3.0, 4.0)], ((1.0,), [2.0])])
def test_lists_of_floats_become_arrays(value):
    array = of_floats(value)
    assert array.dtype == np.float64
    np.testing.assert_array_equal(array, np.asarray(value))


@pytest.mark.parametrize(
    "value", [None, [], 1.0, [1, 2.0], [True, 1.0], [None, 1.0], [[1.0], [2.0, 3.0]], [[1.0], 2.0], [np.float64(1.0)]]
)
def test_all_else_stays_as_it_is_for_who_says_what_is_wrong(value):
    assert of_floats(value) is value


def test_a_subclass_is_no_plain_list():
    class Mine(list):
        """Its elements may be anything."""

    mine = Mine([1.0])
    assert of_floats(mine) is mine
