"""Exit codes: 0 done, 2 wrong use, 3 bad input, 4 internal error, 130 interrupted; and what is said with each."""

import errno

import pytest

MODEL = ("--model", "three_beacon_psd")


@pytest.fixture(autouse=True)
def no_debugging(monkeypatch):
    monkeypatch.delenv("RELNAV_DEBUG", raising=False)


def test_done(run, short_log, tmp_path):
    code, out, err = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 0
    assert err == ""
    assert len((tmp_path / "track.csv").read_text().splitlines()) > 200
    assert f"track: {tmp_path / 'track.csv'}" in out


WRONG_USE = {
    "no such command": (["filtre"], "No such command 'filtre'; did you mean 'filter'?"),
    "no log": (["filter", *MODEL], "Missing argument 'LOG'"),
    "no model": (["filter", "LOG"], "Missing option '--model'"),
    "log that is not there": (["filter", "nowhere.csv", *MODEL], "'nowhere.csv' does not exist"),
    "unknown model": (["filter", "LOG", "--model", "three_beacon_pds"], "did you mean 'three_beacon_psd'?"),
    "unknown method": (["filter", "LOG", *MODEL, "--method", "ukf"], "'ukf' is not one of 'fix', 'spots'"),
    "unknown option": (["filter", "LOG", *MODEL, "--methods", "fix"], "No such option"),
    "missing folder": (["filter", "LOG", *MODEL, "--out", "none/track.csv"], "the folder none does not exist"),
    "missing folder of JSON": (["filter", "LOG", *MODEL, "--json", "none/a.json"], "the folder none does not exist"),
    "unknown ending": (
        ["filter", "LOG", *MODEL, "--out", "track.xyz"],
        ".parquet, other formats in .oem, .aem, .mat, .nc,",
    ),
    "no ending": (["filter", "LOG", *MODEL, "--out", "track"], "a table ends in .csv"),
    "models of no such name": (["models", "psd"], "no model 'psd'"),
}


@pytest.mark.parametrize("name", WRONG_USE)
def test_wrong_use_is_2(run, short_log, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    arguments, text = WRONG_USE[name]
    code, out, err = run(*(short_log if argument == "LOG" else argument for argument in arguments))
    assert code == 2
    assert text in err
    assert out == ""
    assert [entry.name for entry in tmp_path.iterdir()] == ["short.csv"]


def test_the_output_is_checked_before_the_work(run, short_log, monkeypatch):
    """An hour's log is not filtered for a folder that is not there."""
    monkeypatch.setattr("relnav.files.logs.LogFile.chunks", lambda *_: pytest.fail("the log was read"))
    assert run("filter", short_log, *MODEL, "--out", "none/track.csv")[0] == 2
    assert run("filter", short_log, *MODEL, "--out", "track.xyz")[0] == 2
    assert run("filter", short_log, *MODEL, "--json", "none/summary.json")[0] == 2


BAD_LOGS = {
    "empty": ("", ": the file is empty"),
    "header only": ("t_s,spot_a_x_um,spot_a_y_um,spot_b_x_um,spot_b_y_um,spot_c_x_um,spot_c_y_um\n", ": no rows"),
    "text": (None, ":5: column 'spot_a_x_um': 'abc' is not a number"),
    "binary": (b"\xff\xfe\x00\x01", ": not a text file"),
}


@pytest.mark.parametrize("name", BAD_LOGS)
def test_a_bad_log_is_3(run, short_log, tmp_path, name):
    content, text = BAD_LOGS[name]
    if content is None:
        lines = short_log.read_text().splitlines()
        cells = lines[4].split(",")
        lines[4] = ",".join([cells[0], "abc", *cells[2:]])
        content = "\n".join(lines)
    short_log.write_bytes(content if isinstance(content, bytes) else content.encode())
    code, out, err = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 3
    assert err.startswith(f"relnav: {short_log}{text}")
    assert err.count("\n") == 1
    assert out == ""
    assert not (tmp_path / "track.csv").exists()


def test_a_bad_model_is_3(run, short_log, tmp_path):
    (tmp_path / "model.toml").write_text('sensor_type = "three_beacon"\n[sensor]\nfocal_length_mm = 0\n')
    code, _, err = run("filter", short_log, "--model", tmp_path)
    assert code == 3
    assert "model.toml:3: sensor.focal_length_mm: input should be greater than 0; got 0" in err


def test_a_cell_longer_than_the_csv_module_takes_is_bad_input(run, short_log):
    """Not an internal error, although the csv module gives up."""
    short_log.write_text(short_log.read_text() + '20.5,"' + "1" * 140_000 + '",0,0,0,0,0,0,0,0\n')
    code, _, err = run("filter", short_log, *MODEL)
    assert code == 3
    assert ":202: " in err


def test_an_internal_error_is_4_and_asks_for_a_report(run, short_log, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("relnav.navigation.log.LogFilter.forward", broken)
    code, _, err = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 4
    assert "internal error, please report it: ZeroDivisionError: division by zero (RELNAV_DEBUG=1 shows where)" in err
    assert not (tmp_path / "track.csv").exists()
    monkeypatch.setenv("RELNAV_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        run("filter", short_log, *MODEL)


def test_a_full_disk_is_3_and_leaves_nothing(run, short_log, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("relnav.files.filter_file.rows_of", full)
    code, out, err = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 3
    assert "No space left on device; nothing was written" in err
    assert out == ""
    assert [entry.name for entry in tmp_path.iterdir()] == ["short.csv"]


def test_nothing_was_written_is_only_said_when_it_is_true(run, short_log, tmp_path, monkeypatch):
    """The track is complete, then the summary finds the disk full: either the track goes too, or it is not denied."""

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("relnav.files.tables.json.dumps", full)
    track, figures = tmp_path / "track.csv", tmp_path / "summary.json"
    code, _, err = run("filter", short_log, *MODEL, "--out", track, "--json", figures)
    assert code == 3
    assert "No space left on device" in err
    assert not figures.exists()
    assert not track.exists() or "nothing was written" not in err


@pytest.mark.parametrize("where", ["reading", "filtering", "writing"])
def test_an_interruption_is_130_and_leaves_nothing(run, short_log, tmp_path, monkeypatch, where):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    place = {
        "reading": "relnav.files.logs.LogFile.chunks",
        "filtering": "relnav.navigation.log.LogFilter.forward",
        "writing": "relnav.files.filter_file.rows_of",
    }
    monkeypatch.setattr(place[where], interrupt)
    (tmp_path / "track.csv").write_text("of yesterday")
    code, out, err = run("filter", short_log, *MODEL, "--out", tmp_path / "track.csv")
    assert code == 130
    assert err.strip() == "relnav: interrupted; nothing was written"
    assert out == ""
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["short.csv", "track.csv"]
    assert (tmp_path / "track.csv").read_text() == "of yesterday"


def test_the_log_is_not_overwritten_by_its_own_track(run, short_log):
    """`--out` that names the input would destroy the flight data."""
    before = short_log.read_bytes()
    code, _, err = run("filter", short_log, *MODEL, "--out", short_log)
    assert short_log.read_bytes() == before
    assert code == 2
    assert str(short_log) in err
