"""Two engines, one contract: ours and filterpy's ExtendedKalmanFilter agree to 1e-9 sigma on flown logs."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def models():
    vbar = relnav.load_model("three_beacon_psd")
    return {
        "vbar": vbar,
        "rbar": relnav.load_model("three_beacon_psd_rbar"),
        "attitude unknown": replace(vbar, attitude=replace(vbar.attitude, mode="unknown")),
    }


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("name", ["vbar", "rbar", "attitude unknown"])
@pytest.mark.parametrize("faults", [Faults(), Faults(dropout=0.05, outliers=0.05)], ids=["clean", "faulted"])
def test_engines_agree(models, name, method, faults, outside):
    model = models[name]
    log = simulate(model, Approach(duration_s=60.0, assumed_start=True), faults, seed=11)
    ours, theirs = (
        relnav.filter_epochs(
            model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2, method=method, engine=engine
        )
        for engine in ("compiled", "filterpy")
    )
    assert np.array_equal(ours.status, theirs.status)
    assert np.array_equal(ours.dof, theirs.dof)
    assert np.array_equal(ours.measurement_status, theirs.measurement_status)
    off = np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma)
    outside("filterpy ExtendedKalmanFilter", f"`{method}` filter, states of a minute, 1-sigma", off, 1e-9)
    assert np.nanmax(np.abs(theirs.sigma / ours.sigma - 1.0)) < 1e-9
    assert np.nanmax(np.abs(theirs.nis - ours.nis) / (1.0 + ours.nis)) < 1e-9


def test_engines_agree_on_a_restart(models):
    model = models["vbar"]
    log = simulate(model, Approach(duration_s=20.0), seed=3)
    later = simulate(model, Approach(duration_s=20.0, start_m=(9.0, -0.2, 0.2)), seed=4)
    spots = np.concatenate([log.spots_m[:100], later.spots_m[:100]])
    t = np.arange(200) * 0.1
    ours, theirs = (
        relnav.filter_epochs(model, t, spots, engine=engine, method="spots") for engine in ("compiled", "filterpy")
    )
    assert ours.restarts == theirs.restarts == 1
    assert np.array_equal(ours.status, theirs.status)
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-9


def test_navigator_takes_the_engine(models):
    navigators = [
        relnav.Navigator(models["vbar"], engine=engine, method="spots") for engine in ("compiled", "filterpy")
    ]
    log = simulate(models["vbar"], Approach(duration_s=3.0), seed=1)
    for t, spots, acceleration in zip(log.t_s, log.spots_m, log.acceleration_m_s2, strict=True):
        ours, theirs = (n.step(t, spots, acceleration_m_s2=acceleration) for n in navigators)
        assert ours.status == theirs.status
    assert np.max(np.abs(ours.state - theirs.state) / np.sqrt(np.diag(ours.covariance))) < 1e-9


def test_an_unknown_engine():
    with pytest.raises(ValueError, match='engine must be "compiled" or "filterpy"; got \'numpy\''):
        relnav.Navigator(relnav.load_model("three_beacon_psd"), engine="numpy", method="spots")
