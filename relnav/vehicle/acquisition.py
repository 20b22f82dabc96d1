"""A start that does not know how the target is turned: every attitude that explains an image is followed.

Three lights have up to four explanations, and one of them alone may be the wrong one for ever. Each opens a hypothesis,
a filter of its own that begins about it. Its score, minus twice the logarithm of its probability but for a constant, is

    |angle from the held attitude|^2 / sigma^2 + sum over images of min(NIS, what the gate lets pass)

and one that lies DROP behind the best is left, as is one by which a light that was seen could not be. Of the image
that opens it a hypothesis takes the attitude alone, known to START_RAD: a glint in it moves the place where the next
image is linearised, not the estimate. Where images contradict the best one it is left with all others, and the next
image opens new ones: `blind` is the estimate of what never saw a light. Images of fewer than LEAST_LIGHTS are not used:
they fix no attitude, and bend within one that is known to START_RAD. Only once one explanation is left, and images
agreed with it, is there one filter.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from relnav.arrays import Matrix
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.spacecraft import FORESEEN_RAD, Vehicle
from relnav.vehicle.layout import TARGET_ATTITUDE, TARGET_RATE
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
"""Attitudes nearer than this, in 1-sigma of the better one, are one."""

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
    """

    blind: Estimates
    hypotheses: tuple[Hypothesis, ...] = ()
    agreed: int = 0
    contradicted: int = 0

    @property
    def estimates(self) -> Estimates:
        """Of the best hypothesis; blind while there is none."""
        return self.hypotheses[0].estimates if self.hypotheses else self.blind

    def moved(self, move: Callable[[Estimates], Estimates]) -> "Search":
        """The same with all estimates moved."""
        moved = tuple(one._replace(estimates=move(one.estimates)) for one in self.hypotheses)
        return self._replace(blind=move(self.blind), hypotheses=moved)

    def passed(self, through: Through) -> tuple["Search", list[Outcome]]:
        """The same after an event that is no image of lights, and what the best one made of it."""
        (blind, outcomes), tried = through(self.blind), [through(one.estimates) for one in self.hypotheses]
        kept = [one._replace(estimates=at) for one, (at, _) in zip(self.hypotheses, tried, strict=True)]
        return self._replace(blind=blind, hypotheses=tuple(kept)), tried[0][1] if tried else outcomes

    def seen(
        self, through: Through, blind: Estimates, explained: Callable[[Estimates], Sequence[Hypothesis]]
    ) -> tuple["Search", list[Outcome]]:
        """The same after an image of LEAST_LIGHTS or more; blind: of its time; explained: what its spots explain."""
        search, best = self._replace(blind=blind), list[Outcome]()
        if self.hypotheses:
            search, best = search._after(through)
        if not self.hypotheses or search.is_contradicted:
            return Search(blind, tuple(sorted(explained(blind), key=lambda one: one.score))), []
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


def hypotheses_about(blind: Estimates, attitudes: Sequence[Matrix], vehicle: Vehicle) -> list[Hypothesis]:
    """Where explanations begin: estimates that know nothing of the target but about which attitude it is held."""
    held, sigma = vehicle.target.dcm_target_from_lvlh.T, vehicle.hand_over.target_attitude_sigma_rad
    found = []
    for dcm in attitudes:
        at = blind.copied()
        at.dcm_lvlh_from_target[:] = dcm
        at.values[:, TARGET_RATE] = -vehicle.orbit.mean_motion_rad_s * dcm[1]
        at.covariance[:, TARGET_ATTITUDE, :] = at.covariance[:, :, TARGET_ATTITUDE] = 0.0
        at.covariance[:, TARGET_ATTITUDE, TARGET_ATTITUDE] = START_RAD**2 * np.eye(3)
        angle = rotation_vector_between(dcm, held)
        found.append(Hypothesis(at, float(angle @ angle) / sigma**2))
    return found


def found_at_start(start: Estimates, found: Estimates, vehicle: Vehicle, frame: OrbitFrame) -> Estimates:
    """The start again, about the attitude found later, turned back by the rate found then."""
    back = found.values[0, TARGET_RATE] * (start.t_s - found.t_s)
    inertial = frame.dcm_lvlh_from_inertial(found.t_s).T @ found.dcm_lvlh_from_target[0]
    attitude = frame.dcm_lvlh_from_inertial(start.t_s) @ turned(inertial, back)
    return hypotheses_about(start, [attitude], vehicle)[0].estimates


def _is_same(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two explanations have become one."""
    turn = rotation_vector_between(other.estimates.dcm_lvlh_from_target[0], one.estimates.dcm_lvlh_from_target[0])
    sigma = np.sqrt(one.estimates.covariance[0].diagonal()[TARGET_ATTITUDE])
    return bool((np.abs(turn) <= SAME_SIGMA * sigma).all())
