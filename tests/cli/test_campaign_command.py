"""`relnav campaign` and `relnav simulate --scenario`: one run alone, what is wrong in one sentence."""

import json
from pathlib import Path

import pytest

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")

SHORT = [
    "--set",
    "approach.duration_s=6",
    "--set",
    "approach.rate_hz=2",
    "--set",
    "spread.start_sigma_m=[0.3, 0.1, 0.1]",
]
BEGIN = ["campaign", "three_beacon_psd", "--seed", "3", *SHORT, "--set", "results.settling_s=1", "--no-pictures"]


def test_a_campaign_and_one_run_of_it(run, tmp_path):
    """--only gives the row of the whole campaign, and the log that `simulate` gives for that run."""
    out = tmp_path / "all"
    code, said, _ = run(*BEGIN, "--runs", "6", "--out", out, "--workers", "1")
    assert code == 0
    assert "6 approaches: ok 6; restarts 0" in said
    assert "entering 4.00 .. 5.00 m: NEES: no data" in said
    code, said, _ = run(*BEGIN, "--runs", "6", "--out", tmp_path, "--only", "4")
    assert (code, said) == (0, f"run 4: OK; {tmp_path / 'run-4'}*\n")
    from pyarrow import parquet

    table = parquet.read_table(sorted((out / "runs").iterdir())[1])
    row = json.loads((tmp_path / "run-4.json").read_text())
    for name in ("final_error_x_m", "final_nees", "drawn_start_x", "nis_sum", "started_s"):
        assert row[name] == table.column(name)[0].as_py(), name
    log, truth = tmp_path / "log.csv", tmp_path / "truth.csv"
    arguments = ["simulate", "three_beacon_psd", "--seed", "3", *SHORT, "--run", "4", "--out", log, "--truth", truth]
    assert run(*arguments, "--quiet")[0] == 0
    assert log.read_bytes() == (tmp_path / "run-4-log.csv").read_bytes()
    assert truth.read_bytes() == (tmp_path / "run-4-truth.csv").read_bytes()


def test_another_campaign_in_the_folder(run, tmp_path):
    assert run(*BEGIN, "--runs", "4", "--out", tmp_path / "out", "--quiet")[0] == 0
    code, _, said = run(*BEGIN, "--runs", "4", "--out", tmp_path / "out", "--set", "focal_length_mm=60")
    assert code == 2
    assert "holds another campaign: model.sensor.focal_length_m is 0.05 there and 0.06 here" in said


def test_an_interrupted_campaign_says_what_is_there(run, tmp_path, monkeypatch):
    """Ctrl-C when the second of two parts is to be written; what is said is true."""
    from relnav.files import campaign_folder

    usual = campaign_folder.write_sealed

    def interrupt(table, path):
        if table.column("run")[0].as_py() > 0:
            raise KeyboardInterrupt
        usual(table, path)

    out = tmp_path / "out"
    command = [*BEGIN, "--runs", "6", "--out", out, "--workers", "1"]
    with monkeypatch.context() as patched:
        patched.setattr(campaign_folder, "write_sealed", interrupt)
        first, second = run(*command), run(*command)
    said = f"1 of 2 parts in {out / 'runs'}; the same command goes on"
    assert (first[0], second[0]) == (130, 130)
    assert first[2].strip() == f"relnav: interrupted; written: {out / 'campaign.json'}, {said}"
    assert second[2].strip() == f"relnav: interrupted; written: {said}"
    assert len(list((out / "runs").glob("part-*.parquet"))) == 1
    assert run(*command)[0] == 0


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--set", "approach.duraton_s=8"], 2, "'approach.duraton_s' cannot be set: no section has it"),
        (["--scenario", "none.toml"], 2, "none.toml: no such scenario file"),
        (["--only", "4"], 2, "--only 4: the campaign has runs 0 to 3"),
        (["--cluster", "local", "--set", "approach.speed_m_s=-1"], 3, "speed_m_s must be positive and finite; got -1"),
    ],
)
def test_what_is_wrong_is_said(run, tmp_path, arguments, code, said):
    ended, _, words = run(*BEGIN, "--runs", "4", "--out", tmp_path / "out", *arguments)
    assert ended == code
    assert said in words
    assert words.count("\n") == 1


def test_other_models_do_not_fly(run, tmp_path):
    code, _, said = run("campaign", "aps_sun", "--runs", "4", "--out", tmp_path / "out")
    assert code == 2
    assert "a campaign flies a three_beacon or three_marker mission, or a vehicle" in said


def test_simulate_refuses_what_a_scenario_says(run, tmp_path):
    code, _, said = run("simulate", "three_beacon_psd", "--out", tmp_path / "log.csv", *SHORT, "--speed", "0.1")
    assert code == 2
    assert "--speed is not for a scenario, which says it itself" in said
    code, _, said = run("simulate", "three_beacon_psd", "--out", tmp_path / "log.csv", "--run", "2")
    assert code == 2
    assert "--run is the run of a scenario" in said


def test_simulate_takes_values_of_the_model(run, tmp_path):
    paths = [tmp_path / name for name in ("plain.csv", "changed.csv")]
    for path, change in zip(paths, ([], ["--set", "spot_noise_um=0.001"]), strict=True):
        assert run("simulate", "three_beacon_psd", "--out", path, "--duration", "2", "--quiet", *change)[0] == 0
    assert Path(paths[0]).read_text() != Path(paths[1]).read_text()


def test_the_script_for_slurm(run, monkeypatch):
    arguments = ["campaign", "three_beacon_psd", "--runs", "1000", "--out", "my results", "--cluster", "slurm"]
    monkeypatch.setattr("sys.argv", ["relnav", *arguments, "--workers", "64"])
    code, said, _ = run(*arguments, "--workers", "64")
    assert code == 0
    assert "#SBATCH --ntasks=64\n" in said
    assert "-m relnav campaign three_beacon_psd --runs 1000 --out 'my results' --cluster \"$place\"\n" in said


def test_a_target_whose_control_misleads_the_filter(run, tmp_path):
    """Told before anything is flown, with the results, and on the page; not of a free one."""
    near = ["--set", "approach.start_m=5.3", "--set", "approach.final_m=5.2", "--set", "gyro.rate_hz=10"]
    turning = ["--set", "hand_over.target_rate_sigma_deg_s=0.3"]
    begin = ["campaign", "rendezvous_demo", "--runs", "1", "--workers", "1", *near, *turning, "--no-pictures", "--out"]
    code, said, told = run(*begin, tmp_path / "held")
    note = json.loads((tmp_path / "held" / "summary.json").read_text())["note"]
    assert code == 0
    assert note.startswith("the target's control changes its rate by 0.3 deg/s (1-sigma) within 100 s, ")
    assert told.startswith(f"note: {note}\n")
    assert f"\nnote: {note}\n" in said
    assert run("report", tmp_path / "held", "--out", tmp_path / "page.html")[0] == 0
    assert "control changes its rate by 0.3 deg/s (1-sigma) within 100 s" in (tmp_path / "page.html").read_text()
    code, said, told = run(*begin, tmp_path / "free", "--set", "approach.target=free")
    assert (code, "note:" in said, "note:" in told) == (0, False, False)
    assert "note" not in json.loads((tmp_path / "free" / "summary.json").read_text())
