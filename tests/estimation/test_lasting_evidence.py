"""An error that lasts counts once: innovations one after another are as likely as all of them at once."""

import numpy as np
import pytest

from relnav.estimation.lasting_evidence import fade, surprise


@pytest.fixture
def images():
    """S0, v and G of six images of two to four rows under three lasting errors."""
    rng, out = np.random.default_rng(2), []
    for rows in (4, 2, 3, 4, 2, 4):
        root = rng.normal(size=(rows, rows))
        out.append((root @ root.T + 0.3 * np.eye(rows), 2.0 * rng.normal(size=rows), rng.normal(size=(rows, 3))))
    return out


def test_one_after_another_is_all_at_once(images):
    """V ~ N(0, S0 + G G^T) of the stacked rows, G holding the same errors for all; evidence is e given v."""
    v, G = np.hstack([one[1] for one in images]), np.vstack([one[2] for one in images])
    S = np.zeros((len(v), len(v)))
    at = 0
    for own, _, _ in images:
        S[at : at + len(own), at : at + len(own)] = own
        at += len(own)
    whole = S + G @ G.T
    expected = v @ np.linalg.solve(whole, v) + np.linalg.slogdet(whole)[1]
    evidence, total = np.eye(4, 3), 0.0
    for own, innovation, shown in images:
        total += surprise(evidence, own.copy(), innovation.copy(), shown.copy(), np.empty(3))
    assert total == pytest.approx(expected, rel=1e-12)
    gain = G.T @ np.linalg.inv(whole)
    np.testing.assert_allclose(evidence[3], gain @ v, rtol=1e-10)
    np.testing.assert_allclose(evidence[:3], np.eye(3) - gain @ G, atol=1e-12)
    anew = sum(
        innovation @ np.linalg.solve(own + shown @ shown.T, innovation) + np.linalg.slogdet(own + shown @ shown.T)[1]
        for own, innovation, shown in images
    )
    assert abs(anew - expected) > 1.0  # what it is not


def test_what_is_forgotten_tends_to_nothing_known(images):
    evidence = np.eye(4, 3)
    surprise(evidence, *(part.copy() for part in images[0]), np.empty(3))
    known = evidence.copy()
    fade(evidence, 0.25)
    np.testing.assert_allclose(evidence, 0.25 * known + 0.75 * np.eye(4, 3))


def test_no_covariance_is_no_likelihood():
    assert surprise(np.eye(2, 1), -np.eye(2), np.ones(2), np.ones((2, 1)), np.empty(1)) == np.inf
