"""Campaigns: the same bytes however they are cut, stopped and taken up again; a run that fails is told by name."""

import dataclasses
import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")

import relnav
import relnav.cli
from relnav.accuracy import run_score
from relnav.accuracy.campaign_plan import Plan, fly_batch
from relnav.accuracy.run_score import RunStatus
from relnav.files.campaign import fly_missing
from relnav.files.campaign_folder import Runs, part_of
from relnav.simulation.dispersions import Results, Scenario, Spread
from relnav.simulation.trajectory import Approach

TINY = Scenario(
    Approach(duration_s=8.0, rate_hz=2.0, assumed_noise=True),
    Spread((0.3, 0.1, 0.1), (0.01, 0.01, 0.01)),
    results=Results((9.0, 9.8, 10.5), 2.0),
)


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def whole(model, tmp_path_factory):
    """A finished campaign of 24 runs in batches of four, by one thread."""
    folder = tmp_path_factory.mktemp("whole")
    relnav.campaign(model, 24, 3, dispersions=TINY, out=folder, workers=1)
    return folder


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("out", [None, "folder"])
def test_without_pyarrow_it_names_the_extra_before_anything_flies(model, out, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(relnav.UsageError, match=r"^the runs of a campaign .* pip install 'relnav\[parquet\]'$"):
        relnav.campaign(model, 10**9, 3, dispersions=TINY, out=out and tmp_path / out)
    assert list(tmp_path.iterdir()) == []


def test_what_a_campaign_leaves(whole, model):
    assert sorted(path.name for path in whole.iterdir()) == [
        "campaign.json",
        "errors_by_range.png",
        "final_errors.png",
        "runs",
        "summary.json",
    ]
    assert [path.name for path in sorted((whole / "runs").iterdir())] == [
        f"part-{start:012d}.parquet" for start in range(0, 24, 4)
    ]
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["outcomes"] == {"ok": 24, "not_started": 0, "lost": 0, "failed": 0}
    table = Runs(whole, Plan(model, TINY, "fix", 3, 24)).table()
    assert table.column("run").to_pylist() == list(range(24))
    rms = np.array(table.column("bin0_rms_range_m")) ** 2 * np.array(table.column("bin0_epochs"))
    known = np.isfinite(rms)
    expected = np.sqrt(rms[known].sum() / np.array(table.column("bin0_epochs"))[known].sum())
    assert summary["bins"][0]["rms"] == pytest.approx(expected, rel=1e-12)
    assert summary["bins"][0]["published"] == 0.02


def test_the_same_bytes_for_any_number_of_workers(whole, model, tmp_path):
    relnav.campaign(model, 24, 3, dispersions=TINY, out=tmp_path / "out", workers=3)
    assert contents(tmp_path / "out") == contents(whole)


def test_a_run_does_not_depend_on_its_batch_or_campaign(whole, model):
    """Alone, in another batch, in a campaign of another length, or in memory: the same figures."""
    table = Runs(whole, Plan(model, TINY, "fix", 3, 24)).table()
    alone = fly_batch(Plan(model, TINY, "fix", 3, 1000), range(17, 18))
    for name, value in zip(Plan(model, TINY, "fix", 3, 1000).columns, alone.figures[0], strict=True):
        assert np.array_equal(table.column(name)[17].as_py(), value, equal_nan=True), name
    memory = relnav.campaign(model, 24, 3, dispersions=TINY, workers=2)
    assert memory.column_names == table.column_names
    for name in table.column_names:
        assert np.array_equal(memory.column(name), table.column(name), equal_nan=name not in ("reason",)), name


def test_the_figures_of_a_run(model):
    """Against the public filter and numpy: NEES, errors and sigmas of a run from its log."""
    log = relnav.simulate(model, TINY, 3, 5)
    track = relnav.filter_epochs(model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2)
    plan = Plan(model, TINY, "fix", 3, 8)
    figures = dict(zip(plan.columns, fly_batch(plan, range(5, 6)).figures[0], strict=True))
    error = track.state - log.truth
    nees = np.array([e @ np.linalg.solve(p, e) for e, p in zip(error, track.covariance, strict=True)])
    assert figures["final_nees"] == pytest.approx(nees[-1], rel=1e-9)
    assert figures["nees_mean"] == pytest.approx(nees[log.t_s >= 2.0].mean(), rel=1e-9)
    assert figures["final_error_y_m"] == error[-1, 1]
    assert figures["final_sigma_vz_m_s"] == pytest.approx(track.sigma[-1, 5], rel=1e-12)
    r = np.linalg.norm(log.truth[:, :3], axis=1)
    late = (log.t_s >= 2.0) & (r >= 9.8) & (r < 10.5)
    bin_ = 1 if late.any() else 0
    inside = late if late.any() else (log.t_s >= 2.0) & (r >= 9.0) & (r < 9.8)

    def angles(p):
        return np.degrees(np.stack([np.arctan2(p[:, 1], p[:, 0]), np.arctan2(-p[:, 2], np.hypot(p[:, 0], p[:, 1]))]))

    off = angles(track.state[inside]) - angles(log.truth[inside])
    assert figures[f"bin{bin_}_epochs"] == inside.sum()
    assert figures[f"bin{bin_}_rms_azimuth_deg"] == pytest.approx(np.sqrt(np.mean(off[0] ** 2)), rel=1e-9)
    assert figures[f"bin{bin_}_rms_elevation_deg"] == pytest.approx(np.sqrt(np.mean(off[1] ** 2)), rel=1e-9)
    first = int(np.flatnonzero(inside)[0])
    assert figures[f"bin{bin_}_nees"] == pytest.approx(nees[first], rel=1e-9)
    assert figures[f"bin{bin_}_sigma_range_m"] == pytest.approx(
        np.sqrt(np.mean(track.docking_sigma[inside, 0] ** 2)), rel=1e-12
    )


def test_a_campaign_goes_on_where_it_was(whole, model, tmp_path):
    """Parts that are there are kept as they are: here one is a mark, and is not flown again."""
    plan, out = Plan(model, TINY, "fix", 3, 24), tmp_path / "out"
    fly_missing(plan, out, 1, None, None)
    for start in (4, 12, 16):
        part_of(out, start).unlink()
    mark = part_of(out, 8)
    before = mark.stat().st_mtime_ns
    told = []
    fly_missing(plan, out, 2, None, told.append)
    assert (sum(told), mark.stat().st_mtime_ns) == (12, before)
    assert contents(out / "runs") == contents(whole / "runs")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"runs": 28}, "runs is 24 there and 28 here"),
        ({"seed": 4}, "seed is 3 there and 4 here"),
        ({"method": "spots"}, "method is fix there and spots here"),
    ],
)
def test_another_campaign_in_the_folder_is_refused(whole, model, change, said):
    plan = dataclasses.replace(Plan(model, TINY, "fix", 3, 24), **change)
    with pytest.raises(relnav.UsageError, match=f"holds another campaign: {said}"):
        fly_missing(plan, whole, 1, None, None)


def test_a_run_that_fails_is_named_and_the_others_complete(whole, model, tmp_path, monkeypatch):
    def poisoned(model, scenario, seed, run, given, fly=run_score.fly_run):
        if run == 13:
            raise FloatingPointError("a poisoned run")
        return fly(model, scenario, seed, run, given)

    monkeypatch.setattr(run_score, "fly_run", poisoned)
    table = relnav.campaign(model, 24, 3, dispersions=TINY, out=tmp_path / "out", workers=2)
    assert table.column("status").to_pylist() == [RunStatus.FAILED if run == 13 else 0 for run in range(24)]
    from pyarrow import parquet

    failed = parquet.read_table(tmp_path / "out" / "failed.parquet")
    assert failed.to_pylist() == [{"run": 13, "reason": "FloatingPointError: a poisoned run"}]
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["outcomes"]["failed"] == 1
    before, after = contents(whole / "runs"), contents(tmp_path / "out" / "runs")
    assert [name for name in before if before[name] != after[name]] == ["part-000000000012.parquet"]


def test_a_damaged_part_is_named(model, tmp_path):
    plan, out = Plan(model, TINY, "fix", 3, 4), tmp_path / "out"
    fly_missing(plan, out, 1, None, None)
    part_of(out, 0).write_bytes(b"PAR1 no more")
    with pytest.raises(relnav.InputError, match=r"part-000000000000\.parquet: damaged"):
        Runs(out, plan).read(["restarts"])
    with pytest.raises(relnav.InputError, match=r"part-000000000000\.parquet: damaged"):
        Runs(out, plan).columns()


@pytest.fixture
def part(whole, model, tmp_path):
    """The first part of a campaign of four runs, copied, and a way to read it as the campaign does."""
    plan = Plan(model, TINY, "fix", 3, 4)
    path = part_of(tmp_path, 0)
    path.parent.mkdir()
    path.write_bytes(part_of(whole, 0).read_bytes())
    return path, lambda: Runs(tmp_path, plan).table()


def test_one_bit_that_changed_is_noticed(part):
    """Anywhere in the file: in values, in names and sizes that no checksum of Parquet covers, in the digest itself."""
    path, read = part
    raw, rng = path.read_bytes(), np.random.default_rng(5)
    footer = int.from_bytes(raw[-8:-4], "little") + 8
    anywhere, behind = rng.integers(len(raw), size=40), len(raw) - 1 - rng.integers(footer, size=40)
    for place in (*anywhere, *behind, raw.index(b"64 zeros") + 60):
        damaged = bytearray(raw)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        with pytest.raises(relnav.InputError, match=r"damaged: its? .*; delete it and go on with the campaign$"):
            read()
    path.write_bytes(raw)
    assert read().column("run").to_pylist() == [0, 1, 2, 3]


def test_a_part_of_another_program_is_refused(part):
    """Nobody knows what its figures were when they were written."""
    parquet = pytest.importorskip("pyarrow.parquet")
    path, read = part
    parquet.write_table(read(), path)
    with pytest.raises(relnav.InputError, match=r"part-0+\.parquet: damaged: it states no SHA-256 .*delete it"):
        read()


def test_a_damaged_part_ends_the_command(tmp_path, capsys):
    """It printed figures of what it read; with the part deleted, the same command flies it again, to the same bytes."""
    (tmp_path / "tiny.toml").write_text(SCENARIO)
    words = ["campaign", "three_beacon_psd", "--runs", "4", "--seed", "3", "--scenario", str(tmp_path / "tiny.toml")]
    words += ["--out", str(tmp_path / "out"), "--no-pictures", "--workers", "1"]
    assert relnav.cli.run([*words, "--quiet"]) == 0
    path = part_of(tmp_path / "out", 0)
    raw = path.read_bytes()
    path.write_bytes(raw[:200] + bytes([raw[200] ^ 64]) + raw[201:])
    capsys.readouterr()
    assert relnav.cli.run(words) == 3
    assert f"{path.name}: damaged: its bytes are not those of the SHA-256 that it states; delete it" in (
        " ".join(capsys.readouterr().err.split())
    )
    path.unlink()
    assert relnav.cli.run([*words, "--quiet"]) == 0
    assert path.read_bytes() == raw


FLY = """
import sys, relnav
relnav.campaign("three_beacon_psd", 24, 3, dispersions=sys.argv[1], out=sys.argv[2], workers=2)
"""
SCENARIO = """
[approach]
duration_s = 8.0
rate_hz = 2.0
assumed_noise = true
[spread]
start_sigma_m = [0.3, 0.1, 0.1]
velocity_sigma_mm_s = [10.0, 10.0, 10.0]
[results]
range_edges_m = [9.0, 9.8, 10.5]
settling_s = 2.0
"""


def test_a_campaign_that_is_killed_goes_on(whole, tmp_path):
    """SIGKILL once a part is there; taken up again the parts have the bytes of a campaign never stopped."""
    (tmp_path / "tiny.toml").write_text(SCENARIO)
    out = tmp_path / "out"
    command = [sys.executable, "-c", FLY, str(tmp_path / "tiny.toml"), str(out)]
    process = subprocess.Popen(command, env=os.environ | {"RELNAV_JIT": "0"})
    end = time.monotonic() + 120.0
    while not list(out.glob("runs/part-*.parquet")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    process.kill()
    process.wait()
    assert 1 <= len(list(out.glob("runs/part-*.parquet"))) <= 6
    subprocess.run(command, env=os.environ | {"RELNAV_JIT": "0"}, check=True, timeout=120)
    assert sorted(contents(out)) == sorted(contents(whole)), "nothing is left over"
    never_stopped = tmp_path / "never stopped"
    subprocess.run([*command[:-1], str(never_stopped)], env=os.environ | {"RELNAV_JIT": "0"}, check=True, timeout=120)
    assert contents(out) == contents(never_stopped)
