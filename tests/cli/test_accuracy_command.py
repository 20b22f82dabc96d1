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


def test_a_changed_design_is_compared_with_the_same_figures(tmp_path, capsys):
    """`--set` measures what a file with that value does, and says so, in the table and in the JSON object."""
    source = find_model("birefringent_sun")
    folder = tmp_path / "birefringent_sun"
    folder.mkdir()
    as_shipped, thinner = "crystal_thickness_mm = { value = 5.0", "crystal_thickness_mm = { value = 4.0"
    text = source.read_text()
    assert as_shipped in text
    (folder / "model.toml").write_text(text.replace(as_shipped, thinner))
    (folder / "published.toml").write_text(source.with_name("published.toml").read_text())
    few = ["--runs", "20"]
    code = run(["accuracy", str(folder), *few])
    by_file = capsys.readouterr().out.splitlines()
    report = tmp_path / "a.json"
    change = ["--set", "crystal_thickness_mm=4"]
    assert run(["accuracy", "birefringent_sun", *few, *change, "--json", str(report)]) == code
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "changed: crystal_thickness_mm=4"
    assert said[1 : len(by_file) + 1] == by_file
    assert json.loads(report.read_text())["change"] == "crystal_thickness_mm=4"
    run(["accuracy", "birefringent_sun", *few])
    assert capsys.readouterr().out.splitlines() != by_file
    assert run(["accuracy", "birefringent_sun", "--set", "crystal_thickness_mm"]) == 2
    assert "--set is written KEY=VALUE" in capsys.readouterr().err
    assert run(["accuracy", "three_beacon_psd", "--faults", "--set", "spot_noise=1"]) == 2
    assert "'spot_noise' cannot be set" in capsys.readouterr().err


def test_wrong_use(tmp_path, capsys):
    assert run(["accuracy", "three_beacon_psd", "--runs", "1"]) == 2
    assert run(["accuracy", "three_beacon_psd", *SMALL, "--plot", str(tmp_path / "none" / "a.png")]) == 2
    assert "the folder" in capsys.readouterr().err
    assert run(["accuracy", "three_beacon_psd", "--runs", "10000", "--plot", str(tmp_path / "a.gif")]) == 2
    assert "a.gif: a picture ends in .png, .pdf or .svg; got '.gif'" in capsys.readouterr().err
