"""Images of beacons that arrive late: the answer is that of the same epochs in order, bit for bit."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.navigation.late_log import filter_late_images
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
    """Images 0.87 s late at 20 mm/s are 17 mm off, ten times the filter's sigma."""
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


@pytest.fixture(scope="module")
def lived(flown):
    """A log of which each row's image was exposed three periods and 0.07 s before; one comes a second too late."""
    t, truth, exposed, spots = flown
    image_t = exposed[:-3].copy()
    image_t[50] -= 1.0
    push = 1e-6 * np.random.default_rng(1).standard_normal((len(image_t), 3))
    return t[3:], spots[:-3], image_t, push, truth[3:]


def test_a_log_is_filtered_as_it_was_lived(patient, lived):
    t, spots, image_t, push, _ = lived
    solution = filter_late_images(patient, t, spots, image_t, acceleration_m_s2=push)
    navigator = relnav.Navigator(patient)
    for k in range(len(t)):
        record = navigator.step(t[k], spots[k], image_t_s=image_t[k], acceleration_m_s2=push[k])
        np.testing.assert_array_equal(solution.state[k], record.state)
        np.testing.assert_array_equal(numbers(record)[:3], [solution.nis[k], solution.dof[k], solution.status[k]])
    np.testing.assert_allclose(solution.covariance[-1], record.covariance, rtol=1e-12)
    assert solution.measurement_status[50] == Status.TOO_LATE
    assert solution.restarts == 0


def test_smoothed_it_is_the_log_of_exposures(patient, lived):
    """Every image where it was exposed, but for the one that came too late: smoothed in that order."""
    t, spots, image_t, push, truth = lived
    solution = filter_late_images(patient, t, spots, image_t, acceleration_m_s2=push, smooth=True)
    rows = [(time, None, push[k]) for k, time in enumerate(t)]
    images = [
        (time, spots[k], push[min(int(np.searchsorted(t, time)), len(t) - 1)])
        for k, time in enumerate(image_t)
        if k != 50
    ]
    events = sorted(rows + images, key=lambda event: event[0])
    nothing = np.full((3, 2), np.nan)
    track = relnav.filter_epochs(
        patient,
        np.array([time for time, _, _ in events]),
        np.array([nothing if image is None else image for _, image, _ in events]),
        acceleration_m_s2=np.array([held for _, _, held in events]),
        smooth=True,
    )
    at = [k for k, (_, image, _) in enumerate(events) if image is None]
    np.testing.assert_array_equal(solution.state, track.state[at])
    np.testing.assert_array_equal(solution.covariance, track.covariance[at])
    filtered = filter_late_images(patient, t, spots, image_t, acceleration_m_s2=push)
    error = np.linalg.norm((solution.state - truth)[10:, :3], axis=1).mean()
    assert error < np.linalg.norm((filtered.state - truth)[10:, :3], axis=1).mean()
    np.testing.assert_array_equal(solution.nis, filtered.nis)


def test_a_file_that_says_when_images_were_exposed(patient, vbar, lived, tmp_path):
    t, spots, image_t, _, _ = lived
    header = "t_s,image_t_s," + ",".join(f"spot_{beacon}_{axis}_um" for beacon in "abc" for axis in "xy")
    table = np.column_stack([t, image_t, 1e6 * spots.reshape(len(t), 6)])
    path = tmp_path / "log.csv"
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in table.tolist())]) + "\n")
    read = relnav.filter_log(path, patient)
    held = filter_late_images(patient, t, spots, image_t)
    np.testing.assert_allclose(read.state, held.state, rtol=1e-9)
    assert read.metadata["log"] == "log.csv"
    with pytest.raises(relnav.UsageError, match="takes images at once"):
        relnav.filter_log(path, patient, engine="filterpy")
    with pytest.raises(relnav.LogError, match=r"column 'image_t_s' says when .* give its \[filter\] a longest_delay_s"):
        relnav.filter_log(path, vbar)
