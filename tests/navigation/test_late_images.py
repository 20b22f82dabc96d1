"""Images of beacons that arrive late: the answer is that of the same epochs in order, bit for bit."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.sensors.measurement import Status

PERIOD_S = 0.2


@pytest.fixture(scope="module")
def patient(vbar):
    return replace(vbar, filter=replace(vbar.filter, longest_delay_s=1.0))


@pytest.fixture(scope="module")
def flown(vbar, drift, look):
    """Epochs at 5 Hz; images exposed 0.07 s before each, but for the first."""
    t = PERIOD_S * np.arange(80)
    exposed = t - 0.07
    truth = drift(vbar, np.concatenate([t, exposed]), [8.0, 0.1, -0.1, -0.02, 1e-3, -1e-3])
    spots = look(vbar, truth, seed=5)
    return t, truth[: len(t)], exposed, spots[len(t) :]


def same(one, other):
    np.testing.assert_array_equal(one.state, other.state)
    np.testing.assert_array_equal(one.covariance, other.covariance)
    assert one.alarm == other.alarm


def numbers(record):
    return np.concatenate([[record.nis, record.dof, record.status], record.innovation])


@pytest.mark.parametrize("method", ["fix", "spots"])
@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_arrival_does_not_matter(patient, flown, method, seed):
    """Delays of up to four periods, some images overtaken by others, a glint among them; control and attitude told."""
    t, _, exposed, spots = flown
    spots = spots.copy()
    spots[40, 0] += 5e-4
    rng = np.random.default_rng(seed)
    attitude = patient.dcm_cam_from_lvlh
    push = 1e-6 * rng.standard_normal((len(t), 3))
    order = relnav.Navigator(patient, method)
    said = {}
    for k in range(len(t)):
        said[k] = order.step(exposed[k], spots[k], acceleration_m_s2=push[k], dcm_cam_from_lvlh=attitude)
        in_order = order.step(t[k], np.full((3, 2), np.nan), acceleration_m_s2=push[k])
    arrives = np.minimum(np.arange(len(t)) + rng.integers(0, 5, len(t)), len(t) - 1)
    late = relnav.Navigator(patient, method)
    for k in range(len(t)):
        record = late.step(t[k], np.full((3, 2), np.nan), acceleration_m_s2=push[k])
        for j in np.flatnonzero(arrives == k):
            record = late.step(t[k], spots[j], image_t_s=exposed[j], dcm_cam_from_lvlh=attitude)
            if arrives[: j + 1].max() == k and k > 10:  # all before it have come
                np.testing.assert_array_equal(numbers(record), numbers(said[j]))
    same(record, in_order)
    assert math.isfinite(record.range_m)


def test_a_late_image_taken_for_a_present_one_is_off(patient, vbar, flown):
    """0.07 s at 20 mm/s is 1.4 mm: as much as the filter's sigma; here one second late is 20 mm."""
    t, truth, _, _ = flown
    errors = {"replayed": [], "as present": []}
    replayed, naive = relnav.Navigator(patient, "spots"), relnav.Navigator(vbar, "spots")
    _, _, _, spots = flown
    for k in range(4, len(t)):
        records = {
            "replayed": replayed.step(t[k], spots[k - 4], image_t_s=t[k - 4] - 0.07),
            "as present": naive.step(t[k], spots[k - 4]),
        }
        for name, record in records.items():
            if k > 30:
                error = record.state[:3] - truth[k, :3]
                errors[name].append(error @ np.linalg.solve(record.covariance[:3, :3], error) / 3.0)
    assert np.mean(errors["replayed"]) < 2.0
    assert np.mean(errors["as present"]) > 3.0 * np.mean(errors["replayed"])


def test_an_epoch_without_an_image_gets_it_later(patient, flown):
    """Exposed at the very time of an epoch that has passed."""
    t, _, _, spots = flown
    order, late = relnav.Navigator(patient), relnav.Navigator(patient)
    nothing = np.full((3, 2), np.nan)
    for k in range(20):
        in_order = order.step(t[k], spots[k], acceleration_m_s2=[1e-5, 0.0, 0.0])
        late.step(t[k], nothing, acceleration_m_s2=[1e-5, 0.0, 0.0])
        if k > 0:
            late.step(t[k], spots[k - 1], image_t_s=t[k - 1])
    record = late.step(t[19] + 0.01, spots[19], image_t_s=t[19])
    same(record, order.step(t[19] + 0.01, nothing))
    np.testing.assert_array_equal(numbers(record), numbers(in_order))


def test_too_late(patient, flown):
    t, _, exposed, spots = flown
    navigator = relnav.Navigator(patient)
    for k in range(20):
        before = navigator.step(t[k], spots[k])
    record = navigator.step(t[19], spots[3], image_t_s=exposed[3])
    same(record, before)
    assert record.status is relnav.EpochStatus.PREDICTED
    assert record.measurement_status is Status.TOO_LATE
    assert math.isnan(record.nis)
    assert len(navigator._late.timeline.passed) <= 7  # what is kept does not grow


def test_the_first_images_may_be_late(patient, flown):
    t, _, exposed, spots = flown
    navigator, nothing = relnav.Navigator(patient), np.full((3, 2), np.nan)
    assert navigator.step(t[5], nothing).status is relnav.EpochStatus.WAITING
    assert navigator.step(t[5], spots[4], image_t_s=exposed[4]).status is relnav.EpochStatus.WAITING
    assert navigator.step(t[5], spots[3], image_t_s=exposed[3]).status is relnav.EpochStatus.STARTED
    assert math.isfinite(navigator.step(t[5], spots[5], image_t_s=exposed[5]).range_m)


def test_a_copy_replays_on_its_own(patient, flown):
    t, _, exposed, spots = flown
    navigator = relnav.Navigator(patient)
    for k in range(20):
        navigator.step(t[k], spots[k])
    other = copy.deepcopy(navigator)
    late = exposed[18], spots[18]
    one, two = (each.step(t[20], late[1], image_t_s=late[0]) for each in (navigator, other))
    same(one, two)
    with pytest.raises(ValueError, match="was taken before"):
        other.step(t[21], late[1], image_t_s=late[0])
    same(navigator.step(t[21], spots[21]), other.step(t[21], spots[21]))  # the refused call left it as it was


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"t_s": 5.0, "image_t_s": 5.1}, "not after t_s"),
        ({"t_s": 5.0, "image_t_s": math.nan}, "must be finite"),
        ({"t_s": 3.0}, "at it with an image that is late"),
        ({"t_s": 4.0, "image_t_s": 3.9, "delta_v_m_s": [0.1, 0.0, 0.0]}, "comes with the first step"),
    ],
)
def test_what_is_refused(patient, flown, call, message):
    _, _, _, spots = flown
    navigator = relnav.Navigator(patient)
    navigator.step(3.8, spots[19])
    navigator.step(4.0, spots[20])
    with pytest.raises(ValueError, match=message):
        navigator.step(spots_m=spots[21], **call)


def test_a_model_without_a_delay_says_what_to_do(vbar, flown):
    _, _, _, spots = flown
    with pytest.raises(ValueError, match="a longest_delay_s"):
        relnav.Navigator(vbar).step(1.0, spots[0], image_t_s=0.9)
    assert relnav.Navigator(vbar).step(1.0, spots[0], image_t_s=1.0).status is relnav.EpochStatus.WAITING
