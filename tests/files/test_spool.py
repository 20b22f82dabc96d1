"""The temporary file of a long log: what is kept comes back; where there is no room the message says where that is."""

import errno

import numpy as np
import pytest

from relnav.files.spool import Spool


def test_what_is_kept_comes_back():
    with Spool() as spool:
        spool.append(np.arange(3.0), np.zeros((0, 2)))
        spool.append(np.arange(4))
        spool.replace(0, np.ones(3), np.zeros((0, 2)))
        np.testing.assert_array_equal(spool[0][0], 1.0)
        assert spool[0][1].shape == (0, 2)
        np.testing.assert_array_equal(spool[1][0], np.arange(4))


def test_the_first_arrays_of_a_group_are_written_alone():
    with Spool() as spool:
        for k in range(3):
            spool.append(np.full((2, 3), float(k)), np.empty((0, 4)), np.arange(k, k + 5))
        spool.replace(1, np.full((2, 3), 7.0))
        first, nothing, rest = spool[1]
        np.testing.assert_array_equal(first, np.full((2, 3), 7.0))
        assert nothing.shape == (0, 4)
        np.testing.assert_array_equal(rest, np.arange(1, 6))
        np.testing.assert_array_equal(spool[2][0], np.full((2, 3), 2.0))


def test_a_full_folder_of_temporary_files_is_named(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with Spool() as spool:
        spool._file.close()
        spool._file = open("/dev/full", "r+b", buffering=0)  # noqa: SIM115  (closed with the spool)
        with pytest.raises(OSError, match=r"TMPDIR names another folder") as caught:
            spool.append(np.zeros(10))
    assert caught.value.errno == errno.ENOSPC
    assert str(tmp_path) in caught.value.filename
