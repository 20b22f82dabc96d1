"""The target-attitude filter is never silently wrong: starts, bursts, gaps, a wrong inertia, a chaser that is off.

The truth is scipy's: Euler's equations by solve_ivp, attitudes as quaternions from an inertial frame. A state counts as
relied on where the status is neither WAITING nor REJECTED.
"""

from time import perf_counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.attitude.target_attitude import METHODS

N = 1.1313666536110223e-3
INERTIA = np.diag([3000.0, 4200.0, 4700.0])
SIGMA = np.radians(0.5)
NOISE = SIGMA**2 * np.eye(3)
WAITING, REJECTED, STARTED = (relnav.EpochStatus[name] for name in ("WAITING", "REJECTED", "STARTED"))


def slow_targets(turning, t, runs, rng, sigma_deg_s, inertia=None):
    """Targets in any attitude, their rate off that of `lvlh_ccsds` by sigma."""
    start = Rotation.random(runs, rng=rng)
    rate = -N * start.as_matrix()[:, 1] + np.radians(sigma_deg_s) * rng.normal(size=(runs, 3))
    return turning(t, start, rate, np.broadcast_to(INERTIA, (runs, 3, 3)) if inertia is None else inertia)


def error_of(record, dcm, rate):
    turn = Rotation.from_matrix(record.dcm_lvlh_from_target.T @ dcm).as_rotvec()
    return np.concatenate([turn, rate - record.rate_rad_s])


def sigmas_off(record, dcm, rate):
    return np.abs(error_of(record, dcm, rate)) / np.sqrt(np.diag(record.covariance))


def make(method, told_deg_s=0.2, density=1e-14, **other):
    return relnav.TargetAttitude(
        INERTIA,
        N,
        rate_noise_density_rad2_s3=density,
        initial_rate_sigma_rad_s=np.radians(told_deg_s),
        method=method,
        **other,
    )


def is_relied_on(record):
    return record.status not in (WAITING, REJECTED)


def noisy(dcm, rng):
    return dcm @ Rotation.from_rotvec(SIGMA * rng.normal(size=(len(dcm), 3))).as_matrix()


def spoilt(seen, kind, rng):
    """Measured attitudes with faults, and which they are.

    Kinds: a start among random attitudes; a burst of up to 30; both; and wrong attitudes that agree with one another,
    as of a wrong root, up to 4 at the start and up to 7 later.
    """
    bad = np.zeros(len(seen), dtype=bool)
    if kind in (0, 2):
        count = rng.integers(1, 15)
        bad[:count] = rng.random(count) < rng.choice([0.3, 0.6, 1.0])
    if kind in (1, 2):
        begin = rng.integers(20, 60)
        bad[begin : begin + rng.integers(1, 31)] = True
    seen = np.where(bad[:, None, None], Rotation.random(len(seen), rng=rng).as_matrix(), seen)
    if kind == 3:
        for begin, longest in ((0, 4), (rng.integers(20, 60), 7)):
            these = slice(begin, begin + rng.integers(1, longest + 1))
            seen[these], bad[these] = seen[these] @ Rotation.random(rng=rng).as_matrix(), True
    return seen, bad


def fly_through_faults(turning, method, runs, seed, rate_hz=10.0):
    """Longest times beyond 5 sigma of a state relied on, in epochs; longest waits for one after a fault, in attitudes.

    One epoch in five has no measured attitude, except where wrong ones agree.
    """
    rng, t = np.random.default_rng(seed), np.arange(120) / rate_hz
    dcm, rate = slow_targets(turning, t, runs, rng, 0.2)
    worst, waits = [], []
    for run in range(runs):
        seen, bad = spoilt(noisy(dcm[:, run], rng), run % 4, rng)
        there = (rng.random(len(t)) < 0.8) | (run % 4 == 3)
        nav, far, wait, longest, longest_wait, in_time = make(method), 0, 0, 0, 0, False
        for k, now in enumerate(t):
            record = nav.step(now, seen[k] if there[k] else None, NOISE)
            relied = is_relied_on(record)
            far = far + 1 if relied and sigmas_off(record, dcm[k, run], rate[k, run]).max() > 5.0 else 0
            longest = max(longest, far)
            if there[k]:
                wait, in_time = (0, False) if bad[k] else (wait + 1, in_time or relied)
                if not in_time and not bad[k]:
                    longest_wait = max(longest_wait, wait)
        worst.append(longest)
        waits.append(longest_wait)
    return np.array(worst), np.array(waits)


@pytest.mark.parametrize("method", METHODS)
def test_starts_and_bursts_of_outliers(turning, method):
    """A tenth of `benchmarks/target_attitude.py faults`."""
    worst, waits = fly_through_faults(turning, method, 100, seed=1)
    assert worst.max() <= 3
    assert waits.max() <= 10


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("angle_deg", [20.0, 90.0, 179.0])
def test_one_bad_attitude_first(turning, method, angle_deg):
    nav, rng = make(method), np.random.default_rng(2)
    t = 0.1 * np.arange(60)
    dcm, rate = slow_targets(turning, t, 1, rng, 0.2)
    seen = noisy(dcm[:, 0], rng)
    seen[0] = seen[0] @ Rotation.from_euler("z", angle_deg, degrees=True).as_matrix()
    records = [nav.step(now, measured, NOISE) for now, measured in zip(t, seen, strict=True)]
    assert [r.status.name for r in records[:3]] == ["WAITING", "WAITING", "STARTED"]
    assert sum(r.accepted for r in records) >= 57
    assert all(sigmas_off(r, d, w).max() < 5.0 for r, d, w in zip(records[2:], dcm[2:, 0], rate[2:, 0], strict=True))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_a_rate_that_was_told_wrong(turning, method, rate_hz):
    """5 deg/s where 0.2 was told: 25 sigma. After 40 attitudes the state is right and stays so."""
    rng, t = np.random.default_rng(4), np.arange(120) / rate_hz
    start = Rotation.random(6, rng=rng)
    axis = rng.normal(size=(6, 3))
    rate = np.radians(5.0) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    dcm, rate = turning(t, start, rate, np.broadcast_to(INERTIA, (6, 3, 3)))
    for run in range(6):
        nav, seen = make(method), noisy(dcm[:, run], rng)
        records = [nav.step(now, measured, NOISE) for now, measured in zip(t, seen, strict=True)]
        for k in range(40, 120):
            assert is_relied_on(records[k]) or records[k].rejections == 1
            assert sigmas_off(records[k], dcm[k, run], rate[k, run]).max() < 5.0


def longest_far_off(turning, method, true_deg_s, runs, rate_hz, seed=5, *, by_the_gate_alone=False):
    """Longest times (runs,) beyond 5 sigma of a state relied on, in epochs: 0.2 deg/s told, the rate another."""
    rng, t = np.random.default_rng(seed), np.arange(80) / rate_hz
    start, axis = Rotation.random(runs, rng=rng), rng.normal(size=(runs, 3))
    rate = np.radians(true_deg_s) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    dcm, rate = turning(t, start, rate, np.broadcast_to(INERTIA, (runs, 3, 3)))
    worst = np.zeros(runs, dtype=int)
    for run in range(runs):
        nav, far = make(method), 0
        if by_the_gate_alone:
            nav.memory["sum_limit"] = np.inf
        for now, measured, true, turn in zip(t, noisy(dcm[:, run], rng), dcm[:, run], rate[:, run], strict=True):
            record = nav.step(now, measured, NOISE)
            far = far + 1 if is_relied_on(record) and sigmas_off(record, true, turn).max() > 5.0 else 0
            worst[run] = max(worst[run], far)
    return worst


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("true_deg_s", "most"), [(2.0, 20), (3.0, 12), (5.0, 8)])
def test_a_rate_that_was_told_wrong_is_seen_in_many_innovations(turning, method, true_deg_s, most):
    """At 10 Hz, each innovation inside the gate, which alone lets it pass for longer."""
    longest = longest_far_off(turning, method, true_deg_s, 20, 10.0).max()
    assert longest <= most
    assert longest_far_off(turning, method, true_deg_s, 20, 10.0, by_the_gate_alone=True).max() > most


@pytest.mark.parametrize("lasts", [False, True], ids=["white", "lasting"])
def test_innovations_of_a_right_filter_are_believed(turning, lasts):
    """At most the gate's one of 10,000, and by the sums one of 90,000 more; with a lasting turn of the chaser too.

    That turn is twice the noise of an image, and the chaser rolls, so that it does not cancel.
    """
    rng, t, sigma = np.random.default_rng(6), 0.1 * np.arange(200), 2.0 * SIGMA
    dcm, _ = slow_targets(turning, t, 50, rng, 0.2)
    chaser = Rotation.from_rotvec(np.outer(0.05 * t, [1.0, 0.0, 0.0])).as_matrix()
    refused = 0
    for run in range(50):
        nav = make("multiplicative", chaser_attitude_sigma_rad=sigma if lasts else 0.0)
        off = Rotation.from_rotvec(sigma * rng.normal(size=3) if lasts else np.zeros(3)).as_matrix()
        turned = np.einsum("nji,jk,nkl->nil", chaser, off, chaser) @ dcm[:, run]
        seen = zip(t, noisy(turned, rng), chaser, strict=True)
        records = [nav.step(now, measured, NOISE, dcm_chaser_from_lvlh=own) for now, measured, own in seen]
        refused += sum(record.status == REJECTED for record in records)
    assert refused <= 5, refused


@pytest.mark.parametrize("method", METHODS)
def test_gaps_of_any_length(method):
    """Positive definite or WAITING, at once; two attitudes start it anew."""
    for gap in (0.1, 10.0, 300.0, 3e3, 1e4, 86400.0, 1e5, 1e7, 1e12):
        for density, told in ((0.0, 1e-3), (1e-12, 0.11), (1e-8, 5.0)):
            nav = make(method, told_deg_s=told, density=density)
            for k in range(50):
                nav.step(0.1 * k, np.eye(3), NOISE)
            begin = perf_counter()
            record = nav.step(4.9 + gap)
            assert perf_counter() - begin < 1.0  # a second, where hours were spent: not a matter of the machine
            if record.status == WAITING:
                assert np.isnan(record.covariance).all()
            else:
                np.linalg.cholesky(record.covariance)
                assert np.sqrt(np.diag(record.covariance)[:3]).max() <= 0.1
            dcm = record.dcm_lvlh_from_target if record.status != WAITING else np.eye(3)
            last = [nav.step(4.9 + gap + 0.1 * k, dcm, NOISE) for k in (1, 2)][-1]
            assert is_relied_on(last) or gap >= 1e12  # where t_s itself has no tenths left


@pytest.mark.parametrize("method", METHODS)
def test_honest_after_gaps(turning, method):
    """Gaps after which 1-sigma of the attitude is just below the limit: NEES of the prediction, 60 runs.

    60 values of chi-square with six degrees of freedom: 0.6 is 4 sigma of their mean over 6.
    """
    rng, t = np.random.default_rng(5), np.append(0.1 * np.arange(10), 24.9)
    dcm, rate = slow_targets(turning, t, 60, rng, 0.2)
    values, turn = [], []
    for run in range(60):
        nav, seen = make(method), noisy(dcm[:, run], rng)
        for now, measured in zip(t[:-1], seen[:-1], strict=True):
            nav.step(now, measured, NOISE)
        record = nav.step(t[-1])
        turn.append(np.sqrt(np.diag(record.covariance)[:3].max()))
        e = error_of(record, dcm[-1, run], rate[-1, run])
        values.append(e @ np.linalg.solve(record.covariance, e) / 6.0)
    assert 0.07 < np.mean(turn) < 0.1
    assert abs(np.mean(values) - 1.0) < 0.6


def nees_by_component(turning, method, runs, seed, tolerance=0.0, alpha_deg=0.0, considered=True):
    """Mean squared errors over their variances (6,), in lvlh and relative to the chaser, from 20 s on; mean NIS / 3.

    The inertia's moments are off by a tolerance and the chaser's attitude by alpha, drawn once a run; the chaser turns.
    """
    rng, t, alpha_sigma = np.random.default_rng(seed), 0.5 * np.arange(200), np.radians(alpha_deg)
    sigma = tolerance * INERTIA
    inertia = INERTIA + sigma * rng.normal(size=(runs, 1, 3))
    dcm, rate = slow_targets(turning, t, runs, rng, 0.5, inertia)
    noise, own, nis = np.radians(0.1) ** 2 * np.eye(3), [], []
    relative = []
    for run in range(runs):
        at, w = Rotation.random(rng=rng), np.radians(0.3) * rng.normal(size=3)
        alpha = Rotation.from_rotvec(alpha_sigma * rng.normal(size=3))
        lasting = {"inertia_sigma_kg_m2": sigma, "chaser_attitude_sigma_rad": alpha_sigma} if considered else {}
        nav = make(method, told_deg_s=0.5, **lasting)
        for k, now in enumerate(t):
            true = (at * Rotation.from_rotvec(w * now)).as_matrix()  # dcm_lvlh_from_chaser
            chaser = (true @ alpha.inv().as_matrix()).T  # as the chaser has it: true = estimate exp([alpha x])
            vision = Rotation.from_rotvec(np.radians(0.1) * rng.normal(size=3)).as_matrix()
            seen = chaser.T @ true.T @ dcm[k, run] @ vision
            record = nav.step(now, seen, noise, dcm_chaser_from_lvlh=chaser)
            if now < 20.0 or k % 20 or record.status == WAITING:
                continue
            own.append(error_of(record, dcm[k, run], rate[k, run]) ** 2 / np.diag(record.covariance))
            nis.append(record.nis)
            chaser_rate = w - N * true.T[:, 1]
            of = record.relative(chaser, chaser_rate)
            between = true.T @ dcm[k, run]  # dcm_chaser_from_target
            turn = Rotation.from_matrix(of.dcm_target_from_chaser @ between).as_rotvec()
            e = np.concatenate([turn, rate[k, run] - between.T @ chaser_rate - of.rate_rad_s])
            relative.append(np.append(e**2 / np.diag(of.covariance), np.sqrt(np.trace(of.covariance[:3, :3]) / 3.0)))
    return np.mean(own, axis=0), np.mean(relative, axis=0), np.mean(nis) / 3.0


@pytest.mark.parametrize("method", METHODS)
def test_an_inertia_that_is_off(turning, method):
    """5 % of each moment, drawn once a run; the rate is half a degree a second. 40 runs: 0.35 is about 1.6 sigma."""
    own, _, nis = nees_by_component(turning, method, 40, seed=6, tolerance=0.05)
    assert (own > 0.6).all()
    assert (own < 1.3).all()
    assert 0.9 < nis < 1.1


def nees_of_moments_off(
    turning, method, runs, deg_s, duration_s, tolerance, inertia=INERTIA, second_order=True, noise_deg=0.1, every_s=0.5
):
    """Moments off by a tolerance, drawn once a run and stated: mean NEES by component (6,), and of all six over 6.

    The rate has a sigma of deg_s about each axis; from 20 s on, every 10 s, where a state is relied on. Attitudes are
    measured to noise_deg, 1-sigma an axis. Without second_order the inertia's effect is taken for linear.
    """
    rng, t, sigma = np.random.default_rng(6), np.arange(0.0, duration_s, every_s), tolerance * inertia
    start = Rotation.random(runs, rng=rng)
    rate = -N * start.as_matrix()[:, 1] + np.radians(deg_s) * rng.normal(size=(runs, 3))
    dcm, rate = turning(t, start, rate, inertia + sigma * rng.normal(size=(runs, 1, 3)))
    noise, joint, each = np.radians(noise_deg) ** 2 * np.eye(3), [], []
    for run in range(runs):
        nav = relnav.TargetAttitude(
            inertia,
            N,
            rate_noise_density_rad2_s3=1e-14,
            initial_rate_sigma_rad_s=np.radians(deg_s),
            method=method,
            inertia_sigma_kg_m2=sigma,
        )
        nav.memory["inertia_off"] = second_order
        seen = dcm[:, run] @ Rotation.from_rotvec(np.radians(noise_deg) * rng.normal(size=(len(t), 3))).as_matrix()
        for k, now in enumerate(t):
            record = nav.step(now, seen[k], noise)
            if now >= 20.0 and k % round(10.0 / every_s) == 0 and is_relied_on(record):
                error = error_of(record, dcm[k, run], rate[k, run])
                joint.append(error @ np.linalg.solve(record.covariance, error) / 6.0)
                each.append(error**2 / np.diag(record.covariance))
    return np.mean(each, axis=0), np.mean(joint)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("deg_s", "tolerance", "noise_deg", "every_s"),
    [
        (0.5, 0.05, 0.1, 0.5),
        (2.0, 0.05, 0.1, 0.5),
        (5.0, 0.05, 0.1, 0.5),
        (2.0, 0.02, 0.1, 0.5),
        (5.0, 0.05, 0.5, 1.0),
    ],
)
def test_an_inertia_that_is_off_for_many_turns(turning, method, deg_s, tolerance, noise_deg, every_s):
    """20 runs of 200 s: 0.4 is some 2 sigma of a mean."""
    each, joint = nees_of_moments_off(
        turning, method, 20, deg_s, 200.0, tolerance, noise_deg=noise_deg, every_s=every_s
    )
    assert each.max() < 1.4
    assert each.min() > 0.5
    assert 0.6 < joint < 1.4


def test_an_inertia_that_is_off_and_attitudes_that_are_not_accurate(turning):
    """60 runs with a degree every two seconds: what adds up for a radian of turn alone gives a joint 1.63."""
    _, joint = nees_of_moments_off(turning, "multiplicative", 60, 5.0, 200.0, 0.05, noise_deg=1.0, every_s=2.0)
    assert 0.7 < joint < 1.3


def test_an_inertia_whose_effect_is_taken_for_linear(turning):
    """The reason for the second order."""
    _, joint = nees_of_moments_off(turning, "multiplicative", 20, 2.0, 200.0, 0.05, second_order=False)
    assert joint > 5.0


def test_an_inertia_that_is_taken_for_the_true_one(turning):
    """The same without its tolerance: the reason why it is considered."""
    own, _, _ = nees_by_component(turning, "multiplicative", 10, seed=6, tolerance=0.05, considered=False)
    assert own.max() > 10.0


@pytest.mark.parametrize("method", METHODS)
def test_relative_to_a_chaser_whose_attitude_is_off(turning, method):
    """0.2 deg that last the whole run: honest in lvlh, and relative to the chaser better than what lasts."""
    own, relative, _ = nees_by_component(turning, method, 40, seed=7, alpha_deg=0.2)
    for values in (own, relative[:6]):
        assert (values > 0.6).all()
        assert (values < 1.3).all()
    assert np.degrees(relative[6]) < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_a_long_run_of_wrong_attitudes_that_agree(turning, method):
    """Twenty replace the track, which nothing in them forbids: STARTED says so, and it is left within ten attitudes."""
    rng, t = np.random.default_rng(12), 0.1 * np.arange(100)
    dcm, rate = slow_targets(turning, t, 4, rng, 0.2)
    for run in range(4):
        nav, seen = make(method), noisy(dcm[:, run], rng)
        seen[40:60] = seen[40:60] @ Rotation.random(rng=rng).as_matrix()
        records = [nav.step(now, measured, NOISE) for now, measured in zip(t, seen, strict=True)]
        assert [r.status for r in records[40:47]] == [REJECTED] * 7
        assert [k for k, r in enumerate(records) if r.status == STARTED] == [1, 47, 67]
        for k in (*range(2, 47), *range(60, 100)):
            if is_relied_on(records[k]):
                assert sigmas_off(records[k], dcm[k, run], rate[k, run]).max() < 5.0
