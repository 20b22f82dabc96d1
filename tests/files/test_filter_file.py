"""From file to file in bounded memory: the same bits as in memory, wherever the chunks end."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.accuracy.run_summary import RunSummary
from relnav.files import logs, parquet, text_table
from relnav.files.filter_file import filter_file
from relnav.files.gathered import Gathered
from relnav.files.models import load_published
from relnav.files.simulated import write_log
from relnav.navigation.log import LogFilter
from relnav.navigation.memory import views
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def flown(model):
    """An approach with faults and a dark time that loses the track: pieces, restarts and empty rows."""
    log = simulate(model, Approach(duration_s=120.0), Faults(dropout=0.1, outliers=0.05), seed=4)
    log.spots_m[400:700] = np.nan
    log.spots_m[900:1000] += [2e-3, 0.0]
    return log


@pytest.fixture(params=[".csv", ".parquet"])
def path(request, flown, tmp_path):
    write_log(flown, tmp_path / f"log{request.param}")
    return tmp_path / f"log{request.param}"


def text(path):
    return [line for line in path.read_text().splitlines() if not line.startswith("#")]


@pytest.mark.parametrize("smooth", [False, True], ids=["filtered", "smoothed"])
@pytest.mark.parametrize("rows", [7, 100, 65_536])
def test_the_same_as_in_memory(model, path, tmp_path, monkeypatch, rows, smooth):
    whole = relnav.filter_log(path, model, smooth=smooth, method="spots")
    relnav.write(whole, tmp_path / "whole.csv")
    monkeypatch.setattr(logs, "CHUNK_LINES", rows)
    monkeypatch.setattr(parquet, "BATCH_ROWS", rows)
    summary = filter_file(path, model, tmp_path / "streamed.csv", smooth=smooth, method="spots")
    assert text(tmp_path / "streamed.csv") == text(tmp_path / "whole.csv")
    assert summary.epochs == len(whole)
    assert summary.accepted == int(whole.accepted.sum())
    assert summary.restarts == whole.restarts
    assert summary.smoothed is smooth
    assert summary.nis.ratio == pytest.approx(whole.nis_consistency().ratio, rel=1e-12)
    assert {status: count for status, count in summary.counts.items() if count} == {
        int(status): int((whole.status == status).sum()) for status in np.unique(whole.status)
    }


def test_a_time_that_goes_back_is_found_across_chunks(model, flown, tmp_path, monkeypatch):
    monkeypatch.setattr(logs, "CHUNK_LINES", 10)
    write_log(flown, tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    head = sum(line.startswith("#") for line in lines) + 1
    lines[head + 10] = "0.85" + lines[head + 10][lines[head + 10].index(",") :]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(
        relnav.LogError, match=rf"log.csv:{head + 11}: time 0.85 s goes back from 0.9 s of the row before"
    ):
        filter_file(tmp_path / "log.csv", model, tmp_path / "track.csv", method="spots")
    assert [entry.name for entry in tmp_path.iterdir()] == ["log.csv"]


def test_progress_counts_every_pass(model, path, monkeypatch):
    monkeypatch.setattr(logs, "CHUNK_LINES", 500)
    monkeypatch.setattr(parquet, "BATCH_ROWS", 500)
    calls = []
    filter_file(path, model, smooth=True, progress=calls.append, method="spots")
    epochs = sum(calls[: len(calls) // 3 + 1])
    assert len(calls) > 3
    assert 2 * epochs < sum(calls) <= 3 * epochs


def test_memory_does_not_grow_with_the_log(model, tmp_path, monkeypatch):
    """Twice the log, the same peak of Python's and numpy's memory (to a tenth), as it is read in small pieces."""
    monkeypatch.setattr(logs, "CHUNK_LINES", 500)
    monkeypatch.setattr(text_table, "BLOCK_BYTES", 50_000)
    log = simulate(model, Approach(duration_s=400.0), Faults(), seed=1)
    write_log(log, tmp_path / "long.csv")
    lines = (tmp_path / "long.csv").read_text().splitlines(keepends=True)
    (tmp_path / "short.csv").write_text("".join(lines[: len(lines) // 2]))
    peaks = []
    for name in ("short.csv", "short.csv", "long.csv"):  # the first run fills caches
        tracemalloc.start()
        filter_file(tmp_path / name, model, tmp_path / "track.csv", smooth=True, method="spots")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.1 * peaks[1]


def test_a_filter_starts_each_log_anew(model):
    assert views(LogFilter(model, method="spots").block).clock["t"] == -np.inf


def test_a_summary_of_rows_is_that_of_the_whole(vbar_log):
    """Handed on in hundreds, with levers that turn with the attitude and with one that is held."""
    solution = relnav.filter_log(vbar_log, "three_beacon_psd")
    model = relnav.load_model("three_beacon_psd")
    lever = np.random.default_rng(3).normal(size=(len(solution), 3))
    for one in (solution, replace(solution, lever_lvlh_m=lever)):
        whole, rows = (RunSummary(load_published(model), 0.9999) for _ in range(2))
        whole.take(one)
        gathered = Gathered(rows.take)
        for k in range(len(one)):
            gathered.take(one.part(k, k + 1))
        gathered.settle()
        said, expected = rows.to_dict(), whole.to_dict()
        for name in ("nis_per_dof", "nis_all_per_dof"):  # sums in another order
            assert said.pop(name) == pytest.approx(expected.pop(name), rel=1e-12)
        assert said == expected
