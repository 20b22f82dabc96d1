"""Errors that last are considered: not estimated, but carried in what is reported (Schmidt 1966).

A calibration leaves an error in every spot coordinate that stays while the spot hardly moves. A filter that takes it
for noise averages it, and becomes overconfident. Here the filter's own factors L D L^T remain those of what is new in
every image; beside them runs S (6, m), what one sigma of each coordinate's lasting error does to the estimate. It is
linear in the measurements, so S is carried as the estimate itself is:

    S = dx/dspots sigma                          at a start from one image
    S <- Phi S                                   from epoch to epoch
    S <- S + P+ H^T R^-1 (E - H S)               at an update: P+ after it, E what the sigmas do to the measured numbers
    S <- S + C (S later - Phi S)                 smoothed (`smoothing.py`)

and P = L D L^T + S S^T is reported. R holds the lasting error too, as if it were new in every image: that keeps gate
and gain sober, and counts in P only what averaging leaves of it, little beside S S^T. A row of `sensitivities` (m, 6)
is a column of S: coordinates A'x, A'y, B'x, ...; without a calibration there are none.
"""

import numpy as np

from relnav._kernel import kernel, straight_line
from relnav.arrays import Matrix, Vector
from relnav.estimation.factored import add_rank_one
from relnav.navigation.block import (
    GRADIENT,
    JACOBIAN,
    OBSERVED,
    POSITION,
    R_FACTOR,
    VARIANCE,
    WORK,
    H,
    beacon_count,
    beacon_row,
)
from relnav.navigation.sight import uses_coordinates


@straight_line(ld=(6, 6), columns=(3, 6))
def _position_columns(ld: Matrix, columns: Matrix) -> None:
    """Write the first three columns of P = L D L^T, of the position, as rows (3, 6)."""
    for k in range(3):
        for i in range(k, 6):
            total = ld[k, k] * (1.0 if i == k else ld[i, k])
            for m in range(k):
                total += ld[i, m] * ld[m, m] * ld[k, m]
            columns[k, i] = total
            if i < 3:
                columns[i, k] = total


@straight_line(row=(6,), columns=(3, 6), information=(3, 3), news=(3,))
def _update(row: Vector, columns: Matrix, information: Matrix, news: Vector) -> None:
    """Replace a row s by s + P+ (news - H^T R^-1 H s); rows H see the position only."""
    change = np.zeros(3)
    for i in range(3):
        change[i] = news[i]
        for j in range(3):
            change[i] -= information[i, j] * row[j]
    for i in range(6):
        row[i] += columns[0, i] * change[0] + columns[1, i] * change[1] + columns[2, i] * change[2]


@straight_line(information=(3, 3), h="***000")
def _inform(information: Matrix, h: Vector, variance: float) -> None:
    """Add h h^T / variance to the information (3, 3)."""
    for i in range(3):
        for j in range(3):
            information[i, j] += h[i] * h[j] / variance


@kernel
def _update_by_coordinates(block: Matrix, sensitivities: Matrix, columns: Matrix, information: Matrix) -> None:
    news = block[WORK + 6]
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        for k in range(2):
            variance = block[row + OBSERVED, 2 + k]
            if variance > 0.0:
                _inform(information, block[row + GRADIENT + k], variance)
    for beacon in range(beacon_count(block)):
        row = beacon_row(block, beacon)
        for k in range(2):
            variance = block[row + OBSERVED, 2 + k]
            weight = block[row + POSITION, 5] / variance if variance > 0.0 else 0.0
            for i in range(3):
                news[i] = block[row + GRADIENT + k, i] * weight
            _update(sensitivities[2 * beacon + k], columns, information, news)


@kernel
def _update_by_position(block: Matrix, sensitivities: Matrix, columns: Matrix, information: Matrix) -> None:
    news, errors = block[WORK + 6], block[WORK + 7 : WORK + 10]  # errors: L^-1 J, of the independent rows
    for m in range(3):
        if block[VARIANCE, m] > 0.0:
            _inform(information, block[H + m], block[VARIANCE, m])
            for j in range(6):
                errors[m, j] = block[JACOBIAN + m, j]
                for k in range(m):
                    errors[m, j] -= block[R_FACTOR + m, k] * errors[k, j]
    for j in range(sensitivities.shape[0]):
        for i in range(3):
            news[i] = 0.0
        if j < 6:
            sigma = block[beacon_row(block, j // 2) + POSITION, 5]
            for m in range(3):
                if block[VARIANCE, m] > 0.0:
                    for i in range(3):
                        news[i] += block[H + m, i] * errors[m, j] * sigma / block[VARIANCE, m]
        _update(sensitivities[j], columns, information, news)


@kernel
def update_sensitivities(block: Matrix, ld: Matrix, sensitivities: Matrix) -> None:
    """Update sensitivities (m, 6) by the rows in use as they were linearised last; ld (6, 6) after the update."""
    if sensitivities.shape[0] == 0:
        return
    columns, information = block[WORK : WORK + 3], block[WORK + 3 : WORK + 6]
    _position_columns(ld, columns)
    for i in range(3):
        for j in range(3):
            information[i, j] = 0.0
    if uses_coordinates(block):
        _update_by_coordinates(block, sensitivities, columns, information)
    else:
        _update_by_position(block, sensitivities, columns, information)


@kernel
def add_considered(ld: Matrix, sensitivities: Matrix) -> None:
    """Replace a filter's own factors (6, 6) by those of what is reported, P + S S^T."""
    for j in range(sensitivities.shape[0]):
        add_rank_one(ld, sensitivities[j])
