"""Refraction: Snell's law measured on the angles, reversibility, total reflection, and leaving a sphere."""

import numpy as np
import pytest

from relnav.geometry.refraction import leave_sphere, refract


@pytest.fixture
def rays():
    rng = np.random.default_rng(4)
    d, n = rng.normal(size=(2, 200, 3))
    d, n = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (d, n))
    return d, n * np.sign(np.sum(d * n, axis=1, keepdims=True))


@pytest.mark.parametrize("mu", [1.0 / 1.5168, 1.0, 1.4585 / 1.5168])
def test_snell(rays, mu):
    d, n = rays
    out = refract(d, n, mu)
    sines = [np.linalg.norm(np.cross(v, n), axis=1) for v in (d, out)]
    np.testing.assert_allclose(sines[1], mu * sines[0], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(out, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(np.stack([d, n, out], axis=1)), 0.0, atol=1e-14)
    np.testing.assert_allclose(refract(out, n, 1.0 / mu), d, atol=1e-12)


def test_total_reflection_is_nan():
    d = np.array([np.sin(0.9), 0.0, np.cos(0.9)])
    assert np.isnan(refract(d, np.array([0.0, 0.0, 1.0]), 1.5)).all()
    assert np.isfinite(refract(d, np.array([0.0, 0.0, 1.0]), 1.2)).all()


def test_leaving_a_sphere(rays):
    d, _ = rays
    centre, start = np.array([0.1, -0.2, 0.3]), np.array([0.2, 0.1, 0.0])
    hit = leave_sphere(start, d, centre, 2.0)
    np.testing.assert_allclose(np.linalg.norm(hit - centre, axis=1), 2.0, atol=1e-14)
    np.testing.assert_allclose(np.cross(hit - start, d), 0.0, atol=1e-14)
    assert np.all(np.sum((hit - start) * d, axis=1) > 0.0)
    assert np.isnan(leave_sphere(np.array([5.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), centre, 2.0)).all()
