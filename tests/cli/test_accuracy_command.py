"""`relnav accuracy`: table, JSON, picture and exit codes."""

import json

from relnav.cli import run
from relnav.files.model_folders import find_model

SMALL = ["--runs", "3", "--seed", "1"]


def test_report_json_and_picture(tmp_path, capsys):
    files = ["--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png")]
    code = run(["accuracy", "three_beacon_psd", *SMALL, *files])
    value = json.loads((tmp_path / "a.json").read_text())
    assert code == (0 if value["ok"] else 1)
    out = capsys.readouterr().out
    assert "single shot, exact form" in out
    assert "settled filter" in out
    assert value["model"] == "three_beacon_psd"
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_unexpected_rows_end_with_exit_code_1(tmp_path, capsys):
    """A mission with twice the spot noise does not meet the claims at 6.5 m, and nobody said so."""
    source = find_model("three_beacon_psd")
    text = source.read_text().replace("spot_noise_um = { value = 10.0", "spot_noise_um = { value = 20.0")
    (tmp_path / "model.toml").write_text(text)
    (tmp_path / "published.toml").write_text(source.with_name("published.toml").read_text())
    assert run(["accuracy", str(tmp_path), *SMALL]) == 1
    out = capsys.readouterr().out
    assert "not met, EXPECTED met" in out
    assert "SOME ROWS DID NOT COME OUT AS EXPECTED" in out


def test_wrong_use(tmp_path, capsys):
    assert run(["accuracy", "three_beacon_psd", "--runs", "1"]) == 2
    assert run(["accuracy", "three_beacon_psd", *SMALL, "--plot", str(tmp_path / "none" / "a.png")]) == 2
    assert "the folder" in capsys.readouterr().err
    assert run(["accuracy", "three_beacon_psd", "--runs", "10000", "--plot", str(tmp_path / "a.gif")]) == 2
    assert "a.gif: a picture ends in .png, .pdf or .svg; got '.gif'" in capsys.readouterr().err
