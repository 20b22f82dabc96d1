"""Whether successive innovations are independent, as those of a filter are whose noise is white.

The innovations of a filter with the right model are white (Kailath 1968, "An innovations approach to least-squares
estimation"). Noise that is correlated from image to image is followed by the estimate as if it were motion: innovations
become smaller, and so does NIS, while errors grow beyond the covariance. It shows between neighbours: with v_k the
innovations of image k, a component each, and q their mean square so far,

    p_k = sum over components of v_k v_(k-1) / q,    z = sum p_k / sqrt(sum p_k^2)

Given the past, v_k has the mean zero, whatever its size is: the p_k are martingale differences, and z is a standard
normal number for many images, also where the noise changes with the range.

An estimate averages many images. The mean of n numbers with the correlation r of neighbours, r^2 of the next but one
and so on, varies (1 + r) / (1 - r) times as much as that of independent ones, for large n. So NIS per degree of freedom
times that is what the covariance is too small by. It is 1 where noise of a correlation time T is stated with (1 + a) /
(1 - a) times its variance, a = exp(-dt / T), though NIS is then small and innovations are still correlated.
"""

import math

import numpy as np

from relnav.arrays import Flags, Matrix, Vector

LEAST_Z = 5.0
"""By chance one run of three million exceeds it."""
SETTLED = 20
"""Images that tell a component's mean square; pairs count from there on."""
LEAST_EXCESS = 1.2
"""Less is not told: of long logs small faults of a model show, such as thrust that is a little off."""


class NeighbourSums:
    """Sums over the images of a run, chunk after chunk."""

    def __init__(self) -> None:
        self._last: Vector = np.empty(0)
        self._squares: Vector = np.empty(0)
        self._count: Vector = np.empty(0)
        self._products, self._products2, self._later2, self._earlier2 = 0.0, 0.0, 0.0, 0.0

    def take(self, innovations: Matrix, used: Flags) -> None:
        """Go on with the next epochs: innovations (n, m), NaN where a component was not measured, and which count."""
        v = np.asarray(innovations, dtype=np.float64)[np.asarray(used)]
        if not len(v):
            return
        if not len(self._last):
            self._last = np.full(v.shape[1], np.nan)
            self._squares, self._count = np.zeros(v.shape[1]), np.zeros(v.shape[1])
        seen = np.isfinite(v)
        v = np.where(seen, v, 0.0)
        squares = np.cumsum(np.concatenate([self._squares[None], v**2]), axis=0)
        count = np.cumsum(np.concatenate([self._count[None], seen]), axis=0)
        before = np.concatenate([np.nan_to_num(self._last)[None], v[:-1]])
        earlier = np.concatenate([np.isfinite(self._last)[None], seen[:-1]])
        known = seen & earlier & (squares[:-1] > 0.0) & (count[:-1] >= SETTLED)
        weight = np.where(known, count[:-1] / np.where(known, squares[:-1], 1.0), 0.0)
        products = (v * before * weight).sum(axis=1)
        self._products += float(products.sum())
        self._products2 += float((products**2).sum())
        self._later2 += float((v**2 * weight).sum())
        self._earlier2 += float((before**2 * weight).sum())
        self._squares, self._count = squares[-1], count[-1]
        self._last = np.where(seen[-1], v[-1], np.nan)

    @property
    def z(self) -> float:
        """Standard normal if innovations are independent; NaN without pairs of images."""
        return self._products / math.sqrt(self._products2) if self._products2 > 0.0 else math.nan

    @property
    def correlation(self) -> float:
        """Of neighbours, -1 to 1; NaN without pairs of images."""
        sizes2 = self._later2 * self._earlier2
        return self._products / math.sqrt(sizes2) if sizes2 > 0.0 else math.nan

    def overconfident(self, ratio: float) -> bool:
        """Whether they are correlated, beyond chance, by what a covariance of this NIS per dof does not include."""
        r = self.correlation
        return self.z > LEAST_Z and ratio * (1.0 + r) > LEAST_EXCESS * (1.0 - r)
