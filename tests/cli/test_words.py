"""Names, titles and metadata of other people in what the commands print and write: no escapes, no forged rows."""

import numpy as np
import pytest

from relnav.files.wording import listed, printable, shown

MODEL = ("--model", "three_beacon_psd")
SPOTS = "t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um"
EVIL = "a\nt_s,x_m\n0,666\r\x1b[31m\x07\u202e"


def clean(text):
    return all(line.isprintable() for line in text.split("\n"))


@pytest.mark.parametrize("text", ["", "plain", "Größe µm 目", EVIL, "\udcff", "\x00", "\u2028", "\x85"])
def test_printable(text):
    assert printable(text).isprintable()
    assert printable(text) == text or not text.isprintable()


def test_shown_and_listed_are_short():
    assert len(shown("x" * 10_000)) < 250
    assert listed(range(100)).endswith("19 and 80 more")
    assert listed(["a", "b\n"]) == "a, b\\n"


def test_metadata_and_column_names_of_parquet(run, tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="the extra `parquet` is not installed")
    from pyarrow import parquet

    columns = [np.arange(20) * 0.1, *(np.full(20, value) for value in (-1500.0, 0, 1500, 0, 0, 0)), np.zeros(20)]
    table = pyarrow.table(columns, names=[*SPOTS.split(","), EVIL])
    log, track = tmp_path / "log.parquet", tmp_path / "track.csv"
    parquet.write_table(table.replace_schema_metadata({"note": EVIL, EVIL: "x", b"\xff\xfe": b"\xff\x00"}), log)
    code, out, err = run("filter", log, *MODEL, "--out", track)
    assert (code, err) == (0, "")
    assert clean(out)
    lines = track.read_text().split("\n")
    assert clean("\n".join(lines))
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    assert lines[head].startswith("t_s,x_m,y_m")
    assert len([line for line in lines[head + 1 :] if line]) == 20, "no row that is not ours"


def test_a_title_and_a_source(run, tmp_path):
    copy = tmp_path / "mine.toml"
    assert run("models", "three_beacon_psd", "--copy", copy)[0] == 0
    text = (
        copy.read_text(encoding="utf-8")
        .replace('title = "', 'title = "\\u001b[31m\\n')
        .replace('why = "Ta', 'why = "\\nTa')
    )
    copy.write_text(text, encoding="utf-8")
    code, out, _ = run("models", copy)
    assert code == 0
    assert clean(out)
    assert "\\x1b[31m\\n" in out


def test_a_file_name(run, tmp_path):
    name = tmp_path / "log\x1b[31m.csv"
    name.write_text("a,b\n")
    code, _, err = run("filter", name, *MODEL)
    assert code == 3
    assert clean(err)
