"""Logs of more than three beacons, and of spots that say how uncertain they are."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.files.filter_file import filter_file
from relnav.files.simulated import write_log
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


def triad(a):
    """A small triangle like the large one, about the same axis."""
    return ((0.0, a, 0.0), (0.0, -a, 0.0), (3.0**0.5 * a, 0.0, 0.0))


@pytest.fixture(scope="module")
def vbar():
    return relnav.load_model("three_beacon_psd")


@pytest.fixture(scope="module")
def layered(vbar):
    """Triads for the last metres within the large one: a = 0.06 m and 0.03 m."""
    return dataclasses.replace(
        vbar, sensor=dataclasses.replace(vbar.sensor, extra_beacons_m=(*triad(0.06), *triad(0.03)))
    )


@pytest.fixture(scope="module")
def flown(layered):
    """From 8 m to 0.6 m before the port."""
    approach = Approach(start_m=(8.0, 0.02, -0.02), final_range_m=0.6, duration_s=400.0)
    return simulate(layered, approach, Faults(), seed=3)


def test_down_to_sixty_centimetres_without_a_jump(layered, flown):
    """The large triangle leaves the detector at 3.75 m, the middle one at 0.75 m; the track does not notice."""
    whole = np.isfinite(flown.spots_m).all(axis=2)
    distance = np.linalg.norm(flown.truth[:, :3], axis=1)
    assert distance[-1] < 0.65
    assert not whole[-1, :2].any()
    assert whole[-1, 6:8].all()
    solution = relnav.filter_epochs(
        layered, flown.t_s, flown.spots_m, acceleration_m_s2=flown.acceleration_m_s2, method="spots"
    )
    assert solution.restarts == 0
    late = flown.t_s > 20.0
    error = (solution.state - flown.truth)[late]
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(solution.covariance[late]), error)
    assert nees.mean() < 9.0
    steps = np.diff(solution.state[late, :3] - flown.truth[late, :3], axis=0)
    assert np.all(np.abs(steps) < 5.0 * solution.sigma[late][1:, :3])
    assert np.abs(error[-1, :3]).max() < 1e-3


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_through_a_file(layered, flown, tmp_path, ending):
    path = tmp_path / f"log{ending}"
    write_log(flown, path)
    solution = relnav.filter_log(path, layered, method="spots")
    direct = relnav.filter_epochs(
        layered, flown.t_s, flown.spots_m, acceleration_m_s2=flown.acceleration_m_s2, method="spots"
    )
    np.testing.assert_allclose(solution.state, direct.state, rtol=0.0, atol=1e-10)
    assert solution.innovation.shape == (len(flown.t_s), 18)
    assert filter_file(path, layered, tmp_path / "track.csv", smooth=True, method="spots").epochs == len(flown.t_s)


def test_a_model_of_other_beacons_is_an_error(vbar, layered, flown, tmp_path):
    write_log(flown, tmp_path / "nine.csv")
    with pytest.raises(relnav.LogError, match=r"nine.csv: spots of 9 beacons; model .* has 3: columns up to spot_c_y"):
        relnav.filter_log(tmp_path / "nine.csv", vbar, method="spots")
    log = simulate(vbar, Approach(duration_s=5.0), Faults(), seed=1)
    write_log(log, tmp_path / "three.csv")
    with pytest.raises(relnav.LogError, match=r"three.csv: spots of 3 beacons; model .* has 9: columns up to spot_i_y"):
        filter_file(tmp_path / "three.csv", layered, method="spots")


def test_a_letter_left_out_is_an_error(flown, tmp_path, layered):
    write_log(flown, tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text().replace("spot_e_x_um,spot_e_y_um", "note,remark")
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(relnav.LogError, match="column 'spot_e_x_um' is missing"):
        relnav.filter_log(tmp_path / "log.csv", layered, method="spots")


@pytest.fixture(scope="module")
def uneven(vbar):
    """A log whose spots are three times noisier in its second half, and say so."""
    log = simulate(vbar, Approach(duration_s=60.0), Faults(), seed=2)
    sigma = np.full(log.spots_m.shape, 1e-5)
    sigma[300:] = 3e-5
    noise = np.random.default_rng(5).normal(size=log.spots_m.shape) * np.sqrt(sigma**2 - 1e-10)
    return dataclasses.replace(log, spots_m=log.spots_m + noise, sigma_m=sigma)


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_spots_that_say_how_uncertain_they_are(vbar, uneven, tmp_path, method):
    write_log(uneven, tmp_path / "log.csv")
    told = relnav.filter_log(tmp_path / "log.csv", vbar, method=method)
    untold = relnav.filter_epochs(
        vbar, uneven.t_s, uneven.spots_m, acceleration_m_s2=uneven.acceleration_m_s2, method=method
    )

    def ratio(solution):
        return float(np.nansum(solution.nis[310:]) / solution.dof[310:].sum())

    assert ratio(told) == pytest.approx(1.0, abs=0.12)
    assert ratio(untold) > 4.0


def test_smoothing_a_streamed_log_with_sigmas_is_the_same(vbar, uneven, tmp_path, monkeypatch):
    from relnav.files import logs

    write_log(uneven, tmp_path / "log.csv")
    relnav.write(relnav.filter_log(tmp_path / "log.csv", vbar, smooth=True, method="spots"), tmp_path / "whole.csv")
    monkeypatch.setattr(logs, "CHUNK_LINES", 50)
    filter_file(tmp_path / "log.csv", vbar, tmp_path / "streamed.csv", smooth=True, method="spots")
    whole, streamed = ((tmp_path / name).read_text().splitlines()[10:] for name in ("whole.csv", "streamed.csv"))
    assert whole == streamed


@pytest.mark.parametrize("sigma", ["0.0", "inf", "1e400", "1e155"])
def test_a_sigma_of_zero_or_beyond_all_sense_is_an_error(vbar, uneven, tmp_path, sigma):
    write_log(uneven, tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[-1] = lines[-1].rsplit(",", 1)[0] + f",{sigma}"
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(
        relnav.LogError, match=rf"log.csv:{len(lines)}: column 'sigma_spot_c_y_um': a sigma above 0, up to 1e\+30, is"
    ):
        relnav.filter_log(tmp_path / "log.csv", vbar, method="spots")


def test_the_same_image_by_image(vbar, uneven):
    navigator = relnav.Navigator(vbar, method="spots")
    whole = relnav.filter_epochs(vbar, uneven.t_s, uneven.spots_m, spot_sigma_m=uneven.sigma_m, method="spots")
    for k in range(400):
        told = uneven.sigma_m[k] if k in (0, 300) else None
        record = navigator.step(uneven.t_s[k], uneven.spots_m[k], spot_sigma_m=told)
    np.testing.assert_array_equal(record.state, whole.state[399])
    with pytest.raises(ValueError, match=r"spot_sigma_m has shape \(3, 2\), above zero, up to 1e\+30"):
        navigator.step(uneven.t_s[400], uneven.spots_m[400], spot_sigma_m=np.zeros((3, 2)))
