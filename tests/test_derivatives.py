"""The derivatives that the tests derive, against differences of the function itself."""

import math

import numpy as np
import pytest

from relnav.codegen.together import quotient, select


def everything(p, m, factor, errors, out):
    """Every operation, both sides of every choice."""
    a = p[0] * m[0, 1] - p[1] / m[1, 0] + errors[0] * p[2]
    b = math.sqrt(p[0] * p[0] + p[2] * p[2] + errors[1])
    out[0] = -a + math.atan2(a * b, p[1] + errors[1] * a)
    out[1] = abs(p[1]) * factor + abs(-a) * errors[0]
    out[2] = select(p[0] > 0.0, a * a, b / p[1]) + select((p[0] <= 0.0) & (b >= a), p[2], -p[0])
    out[3] = quotient(p[2], b + errors[2], 7.0) + quotient(p[0], -b, factor)
    out[4] = factor


SHAPES = {"p": (3,), "m": (2, 2), "errors": (3,), "out": (5,)}


@pytest.mark.parametrize("p", [[0.7, -0.4, 1.1], [-0.7, 0.3, 0.9]])
def test_against_differences(derivatives, p):
    p, m, none = np.array(p), np.array([[0.3, 1.7], [-0.6, 0.2]]), np.zeros(3)
    places = {"p": p, "m": m, "errors": none}
    for by, at in places.items():

        def written(x, by=by):
            out = np.empty(5)
            given = places | {by: x.reshape(places[by].shape)}
            everything(given["p"], given["m"], 0.4, given["errors"], out)
            return out

        got = derivatives.derivative(everything, of="out", by=by, **SHAPES)(p, m, 0.4, none)
        expected = [(written(at.ravel() + h) - written(at.ravel() - h)) / 2e-6 for h in 1e-6 * np.eye(at.size)]
        np.testing.assert_allclose(got, np.transpose(expected), atol=1e-8)
    at_zero = derivatives.derivative(everything, of="out", by="errors", at_zero=True, **SHAPES)
    np.testing.assert_allclose(at_zero(p, m, 0.4), got, rtol=1e-14)


def test_what_is_known_falls_away(derivatives):
    def product(matrix, errors, out):
        for i in range(2):
            out[i] = matrix[i, 0] * errors[0] + matrix[i, 1] * errors[1]

    shapes = {"matrix": (2, 2), "errors": (2,), "out": (2,)}
    assert derivatives.derivative(product, of="out", by="errors", at_zero=True, **shapes).operations == 0
    assert derivatives.derivative(product, of="out", by="matrix", **shapes).operations == 0
