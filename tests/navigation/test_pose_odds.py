"""Odds of the leading hypothesis of markers against others, and whether it is contested, from numbers by hand."""

import math

import pytest

import relnav
from relnav.navigation.memory import fill
from relnav.navigation.pose_epoch import ambiguity_of, is_contested
from relnav.navigation.pose_memory import new_pose_memory, pose_views
from relnav.navigation.pose_propagation import odds_against

LIMIT = 2.0 * math.log(1e4)


def bank(*hypotheses, blurred=-math.inf, renewed=90.0):
    """A memory at 100 s with hypotheses of these (score, doubt, prior)."""
    m = pose_views(new_pose_memory(relnav.load_model("three_marker_vision")))
    fill(m.clock, t=100.0, running=len(hypotheses), blurred=blurred, renewed=renewed)
    for k, (score, doubt, prior) in enumerate(hypotheses):
        fill(m.bank[k], score=score, doubt=doubt, prior=prior)
    return m


def test_odds_count_what_was_known_before_of_both():
    m = bank((-50.0, 3.0, 27.0), (-40.0, 4.0, 54.0))
    assert odds_against(m.bank[1], m.bank[0]) == (-40.0 + 54.0 - 4.0) - (-50.0 + 27.0)
    assert ambiguity_of(m) == 33.0


@pytest.mark.parametrize(
    ("odds", "prior", "lead_prior", "contested"),
    [
        (LIMIT - 0.1, 0.0, 0.0, True),
        (LIMIT + 0.1, 0.0, 0.0, False),
        (5.0, 27.0, 0.0, False),  # it began less likely
        (5.0, 27.0, 27.0, True),
        (LIMIT + 0.1, 27.0, 27.0, False),
        (5.0, 0.0, 27.0, True),  # it led before
    ],
)
def test_one_that_began_less_likely_does_not_contest(odds, prior, lead_prior, contested):
    m = bank((-50.0, 0.0, lead_prior), (-50.0 + lead_prior + odds - prior, 0.0, prior))
    assert ambiguity_of(m) == pytest.approx(odds)
    assert bool(is_contested(m)) is contested


@pytest.mark.parametrize("undecided", [{"blurred": 97.0}, {"renewed": -math.inf}])
def test_a_wide_pose_and_one_without_its_second_hypothesis_are_contested_alone(undecided):
    assert not is_contested(bank((-50.0, 0.0, 0.0)))
    assert not is_contested(bank((-50.0, 0.0, 0.0), blurred=90.0))
    m = bank((-50.0, 0.0, 0.0), **undecided)
    assert is_contested(m)
    assert ambiguity_of(m) == 0.0
