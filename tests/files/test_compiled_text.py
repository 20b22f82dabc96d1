"""Long tables are written and read by compiled code: the same bytes, the same bits, and the same sentences."""

import os
import subprocess
import sys

import numpy as np
import pytest

from relnav.errors import LogError
from relnav.files import compiled_text, tables
from relnav.files.logs import read_log
from relnav.files.text_table import MOST_EMPTY_LINES

HEAD = "t_s,spot_a_x_um,note,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
ROW = "{},-1500.25,12,{},1500,0,0,2.5e-3"
GOOD = {
    "plain": [ROW.format(k, 0.1 * k) for k in range(9)],
    "missing": [ROW.format(0, ""), ROW.format(1, "nan"), ROW.format(2, " NaN "), "3,,,,,,,", "4, , , , , , , "],
    "signs and exponents": [
        ROW.format("-1.", "+.5"),
        ROW.format("0", "-0"),
        ROW.format("1e0", "12E+2"),
        ROW.format(2, "1e-30"),
    ],
    "left to Python": [ROW.format(0, "inf"), ROW.format(1, "0.1000000000000000000001"), ROW.format(2, "1e-300")],
    "spaces": [ROW.format(k, 1).replace(",", " ,\t") for k in range(3)],
    "blank lines and comments": ["", ROW.format(0, 1), "  ", "# a, b", ROW.format(1, 2), " #", ROW.format(2, 3), ""],
    "other words": [ROW.format(k, k).replace("12", word) for k, word in enumerate(["", "ab c", "1_5", "-"])],
    "quoted": [ROW.format(0, '"7"'), ROW.format(1, 8)],
    "letters of other alphabets": [ROW.format(k, k).replace("12", "für") for k in range(3)],
}
BAD = {
    "text": [ROW.format(0, 1), ROW.format(1, "1_5")],
    "a sign alone": [ROW.format(0, 1), "", ROW.format(1, "-")],
    "a point alone": [ROW.format(0, 1), ROW.format(1, ".")],
    "an exponent without digits": [ROW.format(0, 1), ROW.format(1, "1e")],
    "another number behind": [ROW.format(0, 1), ROW.format(1, "1 2")],
    "a short row": [ROW.format(0, 1), ROW.format(1, "x"), "2,3"],
    "a long row": [ROW.format(0, 1), ROW.format(1, 2) + ","],
    "a time that goes back": [ROW.format(0, 1), ROW.format(-1, 2)],
    "nothing for long": [ROW.format(0, 1), *[""] * (MOST_EMPTY_LINES + 2), ROW.format(1, 2)],
    "no text": [ROW.format(0, 1), "\udcff"],
}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("rows", GOOD.values(), ids=GOOD)
@pytest.mark.parametrize("compiled", [True, False])
def test_what_is_read_either_way(tmp_path, monkeypatch, rows, end, compiled):
    monkeypatch.setattr(compiled_text, "worth_reading", lambda _numbers: compiled)
    path = tmp_path / "log.csv"
    path.write_bytes(end.join([HEAD, *rows]).encode())
    cells = [row.replace('"', "").split(",") for row in rows if row.strip() and row.strip()[0] != "#"]
    expected = np.array([[float(cell) if cell.strip() else np.nan for cell in row[:2] + row[3:]] for row in cells])
    log = read_log(path)
    np.testing.assert_array_equal(log.t_s, expected[:, 0])
    np.testing.assert_array_equal(log.spots_m.reshape(-1, 6), expected[:, 1:] / 1e6)


@pytest.mark.parametrize("rows", BAD.values(), ids=BAD)
def test_what_is_refused_either_way(tmp_path, monkeypatch, rows):
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join([HEAD, *rows]).encode(errors="surrogateescape"))
    said = []
    for way in (True, False):
        monkeypatch.setattr(compiled_text, "worth_reading", lambda _numbers, way=way: way)
        with pytest.raises(LogError) as caught:
            read_log(path)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_a_table_has_the_same_bytes_either_way(tmp_path, monkeypatch):
    """Some thousand rows, more than are written at once, with numbers that are missing and whole ones."""
    rng = np.random.default_rng(1)
    columns = [*rng.normal(size=(4, 5_000)) ** 9, rng.integers(-12, 1_000_000, 5_000).astype(np.float64)]
    columns[1][rng.random(5_000) < 0.3] = np.nan
    for way in (True, False):
        monkeypatch.setattr(tables, "worth_writing", lambda _numbers, way=way: way)
        tables.write_table(tmp_path / f"{way}.csv", tuple("abcde"), iter([columns]), {"a": "b"}, (4,))
    assert (tmp_path / "True.csv").read_bytes() == (tmp_path / "False.csv").read_bytes()


def test_what_is_followed_has_the_code_from_its_first_row_on(tmp_path):
    """In a process and a cache of its own; short tables are left to Python before."""
    code = (
        "from relnav.files.compiled_text import prepare, worth_reading, worth_writing\n"
        "print(worth_writing(1), worth_reading(1))\nprepare()\nprint(worth_writing(1), worth_reading(1))\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    code += "import sys\nprint('numba' in sys.modules)\n"
    for jit, said in (("1", ["True True"]), ("1", ["True True", "False"]), ("0", ["False False", "False"])):
        environment["RELNAV_JIT"] = jit
        ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        assert ran.stdout.splitlines()[1:][: len(said)] == said  # the second time it is at hand, without numba
