"""A start that does not know how the target is turned, or where it is: every explanation of an image is followed.

Three lights have up to four explanations, and one of them alone may be the wrong one for ever. Each opens a hypothesis,
a filter of its own that begins about it. Its score, minus twice the logarithm of its probability but for a constant, is

    |angle from the held attitude|^2 / sigma^2 + sum over images of min(NIS, what the gate lets pass)

and one that lies DROP behind the best is left, as is one by which a light that was seen could not be. Of the image
that opens it a hypothesis takes the attitude alone, known to START_RAD: a glint in it moves the place where the next
image is linearised, not the estimate. Where images contradict the best one it is left with all others, and the next
image opens new ones: `blind` is the estimate of what never saw a light. Images of fewer than LEAST_LIGHTS are not used:
they fix no attitude, and bend within one that is known to START_RAD. Only once one explanation is left, and images
agreed with it, is there one filter. Where a caller states the attitude (`hand_over`), the angle is from that, and its
covariance stands in place of sigma^2.

The same after a lock-out: of LOST_IMAGES in a row half of the lights or less was believed, and no other image more for
long. (At a wrong place a filter goes on to find single lights that agree with it.) Nothing is known then
of where the target is, so that an explanation brings its place too; and the filter that was locked out is one of them,
for the images may be what was wrong.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.estimation.state_layout import StateLayout
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.spacecraft import FORESEEN_RAD, POINTS, Vehicle
from relnav.vehicle.hand_over import Start
from relnav.vehicle.layout import POSITION, TARGET_ATTITUDE, TARGET_RATE, VELOCITY
from relnav.vehicle.orbit_frame import OrbitFrame
from relnav.vehicle.state import Estimates
from relnav.vehicle.update import Outcome

START_RAD = 0.3
"""1-sigma of a hypothesis' attitude at first: wide beside what an image tells."""
DROP = 2.0 * float(np.log(1e6))
"""Twice the logarithm of how much less likely than the best a hypothesis is that is left."""
AGREED = 10
"""Images that must agree with the last one."""
CONTRADICTED = 3
"""Images, and more than a third of those that agree, after which explanations are looked for anew."""
SAME_SIGMA = 1.0
"""Poses nearer than this, in 1-sigma of the better one, are one."""
LOST_IMAGES = 10
"""Of a sensor, doubted one after the other, before a filter is locked out.

A right filter doubts an image of three lights once in 3e7: two of them have to miss a gate of 0.9999.
"""
START_SHARE, START_M_S, START_RAD_S = 0.1, 1.0, 0.05
"""1-sigma of a hypothesis' position by its distance, of its velocity (at rest) and of the target's rate, anew.

Wide beside what images tell: ten times the closing rates flown here, and a target that tumbles at 3 deg/s.
"""
KEPT = ("chaser_attitude", "gyro_bias", "gyro.scale", "gyro.misalignment")
"""Errors that lights tell little of."""

Through: TypeAlias = Callable[[Estimates], tuple[Estimates, list[Outcome]]]
"""What an event makes of estimates, and what became of it."""


class Hypothesis(NamedTuple):
    """One explanation: its estimates and its score."""

    estimates: Estimates
    score: float


class Search(NamedTuple):
    """A start that is not over.

    Attributes
    ----------
    blind : Estimates
        Without any light.
    hypotheses : tuple of Hypothesis
        The best one first.
    agreed, contradicted : int
        Images of which the best one then believed more than two thirds of the lights, and less.
    before : Estimates or None
        Of the filter that was locked out, which is one of the explanations; None at a start.
    """

    blind: Estimates
    hypotheses: tuple[Hypothesis, ...] = ()
    agreed: int = 0
    contradicted: int = 0
    before: Estimates | None = None

    @property
    def estimates(self) -> Estimates:
        """Of the best hypothesis; blind while there is none."""
        return self.hypotheses[0].estimates if self.hypotheses else self.blind

    def moved(self, move: Callable[[Estimates], Estimates]) -> "Search":
        """The same with all estimates moved."""
        moved = tuple(one._replace(estimates=move(one.estimates)) for one in self.hypotheses)
        before = None if self.before is None else move(self.before)
        return self._replace(blind=move(self.blind), hypotheses=moved, before=before)

    def passed(self, through: Through) -> tuple["Search", list[Outcome]]:
        """The same after an event that is no image of lights, and what the best one made of it."""
        (blind, outcomes), tried = through(self.blind), [through(one.estimates) for one in self.hypotheses]
        kept = [one._replace(estimates=at) for one, (at, _) in zip(self.hypotheses, tried, strict=True)]
        before = None if self.before is None else through(self.before)[0]
        return self._replace(blind=blind, hypotheses=tuple(kept), before=before), tried[0][1] if tried else outcomes

    def seen(
        self, through: Through, blind: Estimates, explained: Callable[[Estimates], Sequence[Hypothesis]]
    ) -> tuple["Search", list[Outcome]]:
        """The same after an image of LEAST_LIGHTS or more; blind: of its time; explained: what its spots explain."""
        before = None if self.before is None else through(self.before)[0]
        search, best = self._replace(blind=blind, before=before), list[Outcome]()
        if self.hypotheses:
            search, best = search._after(through)
        if not self.hypotheses or search.is_contradicted:
            return opened(blind, explained(blind), before), []
        return search, best

    def _after(self, through: Through) -> tuple["Search", list[Outcome]]:
        """The hypotheses after an image, without those that fell behind, and what the best one made of it."""
        after = [through(one.estimates) for one in self.hypotheses]
        most, tried = max(outcomes[0].groups for _, outcomes in after), []
        for one, (at, outcomes) in zip(self.hypotheses, after, strict=True):
            nis, _, groups, _, credible, *_ = outcomes[0]
            tried.append((Hypothesis(at, one.score + min(nis, credible) + DROP * (most - groups)), outcomes))
        tried.sort(key=lambda item: item[0].score)
        best = tried[0][1]
        if best[0].groups == 0:
            return self._replace(hypotheses=tuple(one for one, _ in tried)), best
        kept = list[Hypothesis]()
        for one, _ in tried:
            if one.score - tried[0][0].score <= DROP and not any(_is_same(other, one) for other in kept):
                kept.append(one)
        agrees = 3 * best[0].used > 2 * best[0].groups
        agreed, contradicted = self.agreed + agrees, self.contradicted + (not agrees)
        return self._replace(hypotheses=tuple(kept), agreed=agreed, contradicted=contradicted), best

    @property
    def is_contradicted(self) -> bool:
        """Whether images say that none of the hypotheses is right."""
        return self.contradicted >= CONTRADICTED and 3 * self.contradicted > self.agreed

    @property
    def is_over(self) -> bool:
        """Whether one explanation is left that images agree with, and whose errors are small ones."""
        if len(self.hypotheses) != 1 or self.agreed < AGREED or self.is_contradicted:
            return False
        variances = self.estimates.covariance[0].diagonal()[TARGET_ATTITUDE]
        return bool(variances.max() < FORESEEN_RAD**2)


def opened(blind: Estimates, explained: Sequence[Hypothesis], before: Estimates | None = None) -> Search:
    """A search that begins with these explanations, and with that of the filter that was locked out."""
    hypotheses = ([] if before is None else [Hypothesis(before, 0.0)]) + list(explained)
    return Search(blind, tuple(sorted(hypotheses, key=lambda one: one.score)), before=before)


def hypothesis_about(blind: Estimates, dcm_lvlh_from_target: Matrix, start: Start, frame: OrbitFrame) -> Hypothesis:
    """Where an explanation begins at a start: nothing is known of the target but about which attitude it is.

    It is held there, unless its rate was stated: that, in the target's axes, is the same about each attitude.
    """
    at = _about(blind, dcm_lvlh_from_target)
    if not start.tells_rate:
        at.values[:, TARGET_RATE] = frame.held_rate(dcm_lvlh_from_target, at.t_s)
    known = blind.covariance[0, TARGET_ATTITUDE, TARGET_ATTITUDE]
    return Hypothesis(at, start.contradiction(dcm_lvlh_from_target, blind.dcm_lvlh_from_target[0], known))


def hypothesis_anew(blind: Estimates, pose: tuple[Matrix, Vector], frame: OrbitFrame) -> Hypothesis:
    """Where an explanation begins after a lock-out: about a pose, and none is more credible than another."""
    at = _about(blind, pose[0])
    at.values[:, TARGET_RATE] = frame.held_rate(pose[0], at.t_s)
    at.values[:, POSITION] = pose[1]
    _forget(at.covariance, POSITION, START_SHARE * float(np.linalg.norm(pose[1])))
    return Hypothesis(at, 0.0)


def _about(blind: Estimates, dcm_lvlh_from_target: Matrix) -> Estimates:
    """What is known without any light, with this attitude of the target, known to START_RAD."""
    at = blind.copied()
    at.dcm_lvlh_from_target[:] = dcm_lvlh_from_target
    _forget(at.covariance, TARGET_ATTITUDE, START_RAD)
    return at


def locked_out(at: Estimates, layouts: Sequence[StateLayout], vehicle: Vehicle) -> Estimates:
    """What filters that are locked out still know: nothing of the target, the thrusters and where lights are seen.

    Kept are the chaser's attitude, the gyro's bias and what is off in sensors that see no lights. layouts: of each.
    """
    blind = at.copied()
    blind_names = {name for name in vehicle.sensor if vehicle.kind(name) != POINTS}
    for block, *others in zip(*(layout.blocks for layout in layouts), strict=True):
        if block.name not in KEPT and block.name.partition(".")[0] not in blind_names:
            _forget(blind.covariance, block.place, np.array([each.sigma for each in (block, *others)]))
            if block.name != "position":
                blind.values[:, block.place] = 0.0
    distance = float(np.linalg.norm(at.values[0, POSITION]))
    wide = (POSITION, distance), (VELOCITY, START_M_S), (TARGET_ATTITUDE, math.pi), (TARGET_RATE, START_RAD_S)
    for place, sigma in wide:
        _forget(blind.covariance, place, sigma)
    return blind


def _forget(covariance: Stack, place: slice, sigma: float | Vector) -> None:
    """Let errors be known to sigma each, and hang together with no others, in covariances (k, n, n); sigma (k,)."""
    covariance[:, place, :] = covariance[:, :, place] = 0.0
    covariance[:, place, place] = np.square(sigma)[..., None, None] * np.eye(place.stop - place.start)


def found_at_start(start: Estimates, found: Estimates, begin: Start, frame: OrbitFrame) -> Estimates:
    """The start again, about the attitude found later, turned back by the rate found then."""
    back = found.values[0, TARGET_RATE] * (start.t_s - found.t_s)
    inertial = frame.dcm_lvlh_from_inertial(found.t_s).T @ found.dcm_lvlh_from_target[0]
    attitude = frame.dcm_lvlh_from_inertial(start.t_s) @ turned(inertial, back)
    return hypothesis_about(start, attitude, begin, frame).estimates


def _is_same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two explanations have become one."""
    turn = rotation_vector_between(other.estimates.dcm_lvlh_from_target[0], one.estimates.dcm_lvlh_from_target[0])
    apart = other.estimates.values[0, POSITION] - one.estimates.values[0, POSITION]
    sigma = SAME_SIGMA * np.sqrt(one.estimates.covariance[0].diagonal())
    return bool((np.abs(turn) <= sigma[TARGET_ATTITUDE]).all() and (np.abs(apart) <= sigma[POSITION]).all())
