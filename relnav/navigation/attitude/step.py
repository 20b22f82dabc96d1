"""What the target-attitude filter makes of a measured attitude: used, rejected, a start, a start anew.

Start: a measured attitude opens a trial, at rest in `lvlh_ccsds` but for what is told of the rate. The next one is
fitted together with it (`trial.py`), later ones are predicted. Those that agree confirm it, as soon as attitudes
without relation would hardly have agreed so well by chance. One that contradicts it opens another trial.

Lock-out: from the first attitude that the track rejects, trials run beside it. After `restart_after` rejections in a
row a trial that two more attitudes have confirmed replaces it; a shorter burst of wrong attitudes, even of ones that
agree with each other, does not. A measured attitude is also rejected where the latest innovations, each inside the
gate, lie together further to one side than chance explains: the track is off then. What was told of the rate is no
longer believed beside and after a contradicted track, nor after three trials in a row that were contradicted: it counts
as unknown, as far as attitudes that often can follow.

A track is dropped when its errors no longer count as small, as over a long gap; the filter then waits for a new start.
"""

import math

import numpy as np

from relnav.arrays import Matrix, Record
from relnav.estimation.factored import compose
from relnav.navigation.attitude.prediction import LARGEST_SIGMA_RAD, take_if_near
from relnav.navigation.attitude.trial import fit_trial, open_trial
from relnav.navigation.status import REJECTED, STARTED, WAITING

LARGEST_CHANCE = 1e-3
"""That attitudes without relation would have agreed as those of a trial did."""
MOST_CONTRADICTED = 3
"""Trials in a row, after which what was told of the rate is not believed."""


def use(memory: Record, measured: Matrix, chaser: Matrix) -> tuple[int, bool]:
    """Use an attitude measured now that the track did not take (`prediction.look`), or where there is none.

    Returns the status, and whether a track was compared. What was found stands in `compared`, the attitude's covariance
    in `given`. memory (1,) of type `prediction.MEMORY`, here and below; chaser (3, 3) is dcm_chaser_from_lvlh.
    """
    m = memory[0]
    interval, noise, running = float(m["interval"]), m["given"], bool(m["running"])
    if running:
        m["rejections"] += 1
        rejected = m["compared"].copy()
    if m["has_trial"] > 0 and _agrees(memory, measured, noise, chaser):
        if _is_confirmed(m):
            m["track"], m["rate_unknown"] = m["trial"], bool(m["rate_unknown"]) or running
            m["running"], m["rejections"], m["has_trial"], m["remembered"], m["bent"]["on"] = 1, 0, 0, 0, 0
            return STARTED, True
    else:
        open_trial(memory, measured, noise, chaser, interval)
    if running:
        m["compared"] = rejected
    return REJECTED if running else WAITING, running


def _agrees(memory: Record, measured: Matrix, noise: Matrix, chaser: Matrix) -> bool:
    """Whether a measured attitude agrees with the trial, which then has learnt from it."""
    m = memory[0]
    if m["agreed"] == 0:
        near = fit_trial(memory, measured, noise, chaser)
    else:
        near = take_if_near(memory, True, measured, noise, chaser, m["trial_gate"])
    if not near:
        m["contradicted"] += 1
        if m["contradicted"] >= MOST_CONTRADICTED:
            m["rate_unknown"] = 1
        return False
    # an attitude taken at random would pass by the gate's share of all rotations, whose volume is 8 pi^2
    volume = (
        4.0 / 3.0 * math.pi * m["trial_gate"] ** 1.5 * math.sqrt(np.linalg.det(m["compared"]["innovation_covariance"]))
    )
    m["chance"] *= min(1.0, volume / (8.0 * math.pi**2))
    m["agreed"], m["contradicted"] = m["agreed"] + 1, 0
    return True


def _is_confirmed(m: Record) -> bool:
    """Whether enough attitudes have agreed with the trial: more of them beside a track."""
    if m["running"] > 0 and (m["agreed"] < 2 or m["rejections"] < m["restart_after"]):
        return False
    if not m["chance"] <= LARGEST_CHANCE:
        return False
    trial = m["trial"]
    variances = np.diagonal(compose(trial["ld"])) + np.sum(trial["lasting"] ** 2, axis=1)
    return bool(variances[:3].max() <= LARGEST_SIGMA_RAD**2)
