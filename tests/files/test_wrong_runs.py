"""Runs that end with a state, which is wrong: a campaign counts them, in its summary, its words and its page."""

import json

import numpy as np
import pytest
from scipy.stats import chi2

pytest.importorskip("pyarrow", reason="campaigns are Parquet files (extra parquet)")

import relnav
from relnav.files.campaign import finish, plan_of
from relnav.files.campaign_page import read_campaign, write_campaign_page

SHORT = {"approach.duration_s": 40.0, "approach.rate_hz": 2.0, "spread.start_sigma_m": [0.5, 0.1, 0.1]}
RUNS = 40


@pytest.mark.parametrize("focal_sigma", [0.0, 0.005])
def test_runs_that_are_wrong_are_counted(tmp_path, focal_sigma):
    """All are ok, as each has a state; a lens that is off, of which the filter knows nothing, makes some wrong."""
    changes = SHORT | {"as_built.focal_length_relative_sigma": focal_sigma}
    scenario = relnav.load_scenario(None, changes)
    table = relnav.campaign("three_beacon_psd", RUNS, 3, dispersions=scenario, method="spots", out=tmp_path, workers=1)
    names = ["final_nees", *(name for name in table.column_names if name.startswith("bin") and name.endswith("_nees"))]
    values = np.array([table.column(name).to_numpy() for name in names])
    wrong = int((np.nanmax(values, axis=0) > chi2.isf(1e-6, 6)).sum())
    assert (0 < wrong < RUNS) == (focal_sigma > 0.0)
    assert json.loads((tmp_path / "summary.json").read_text())["wrong"] == wrong
    summary = finish(
        plan_of(relnav.load_model("three_beacon_psd"), scenario, "spots", 3, RUNS), tmp_path, pictures=None
    )
    lines = summary.lines()
    assert lines[0] == f"{RUNS} approaches: ok {RUNS}; restarts 0"
    said = f"WRONG in {wrong} of {RUNS} runs: errors far beyond sigma (NEES beyond one in a million, "
    assert lines[1].startswith(said) == (wrong > 0)
    write_campaign_page(read_campaign(tmp_path), tmp_path / "page.html")
    colour = "bad" if wrong else "good"
    assert f'runs that were wrong</span><b class="{colour}">{wrong}</b>' in (tmp_path / "page.html").read_text()
