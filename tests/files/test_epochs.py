"""Epochs as a user writes them."""

import erfa
import pytest

import relnav
from relnav.files.epochs import julian_year


def test_a_julian_year():
    assert julian_year("2026.5") == 2026.5


@pytest.mark.parametrize("text", ["2019-07-29T20:47:26", "2019-07-29T22:47:26+02:00"])
def test_a_date_is_sofas_julian_year(text):
    expected = erfa.epj(*erfa.dtf2d("UTC", 2019, 7, 29, 20, 47, 26.0))
    assert julian_year(text) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("text", ["yesterday", "2019-13-01", "nan", "1850", "9999"])
def test_anything_else(text):
    with pytest.raises(relnav.UsageError, match="--epoch"):
        julian_year(text)
