"""Which sensor the innovations say is drifting: the sums of `drift_sums` judged, one hypothesis beside the other.

Looked for is a drift of the mounting of each sensor and of its focal scale, by which all that it sees shifts or grows
(a clock that jumps makes lights seem to grow in an approach), of the gyro's bias, and of the slow acceleration, which
is what faulty thrusters, or a target that pushes, leave to be explained. A chi-square as far out as a sum of squared
innovations in alarm (`monitor`) is an alarm. Often one drift looks like another: a star sensor that turns away is,
without a third that knows the attitude as well, a gyro whose bias is off. Then the chi-square of the other is the
squared cosine between what the two do to the innovations, times that of the right one, so that every one with
LEAST_SHARE of the largest is named.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import nan

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.estimation.state_layout import StateLayout
from relnav.spacecraft import GYRO, THRUST
from relnav.vehicle.layout import GYRO_BIAS, SLOW_ACCELERATION
from relnav.vehicle.monitor import ALARM_SIGMA, deviation_of

WATCHED = ("mount", "focal")
"""Of the lasting errors of a sensor: how it is turned, and how large it sees. Of one that has neither, the first."""
LEAST_SHARE = 0.5
"""Of the largest chi-square: two drifts that differ by less than 45 deg in what they do to innovations."""
LEAST_PIVOT = 1e-9
"""Share of the largest eigenvalue of the information below which a direction of a drift is not seen at all."""


def watched_drifts(layout: StateLayout, sensors: Iterable[str]) -> dict[str, Codes]:
    """The places of errors that are watched for a drift, by the name of what would be at fault."""
    everything, drifts = np.arange(layout.size), dict[str, Codes]()
    for name in sensors:
        own = {block.name: block.place for block in layout.blocks if block.name.startswith(f"{name}.")}
        watched = [own[f"{name}.{kind}"] for kind in WATCHED if f"{name}.{kind}" in own] or [*own.values()][:1]
        if watched:
            drifts[name] = np.concatenate([everything[place] for place in watched])
    return drifts | {GYRO: everything[GYRO_BIAS], THRUST: everything[SLOW_ACCELERATION]}


@dataclass(frozen=True)
class Drifts:
    """How far the innovations of the last seconds look like drifts.

    Attributes
    ----------
    sizes : mapping
        Errors that are watched, by the name of a sensor, "gyro" or "thrust"; empty without a filter that watches.
    score, information : (k,), (k, k)
        d and J of `drift_sums`.
    """

    sizes: Mapping[str, int]
    score: Vector
    information: Matrix

    @cached_property
    def _tests(self) -> dict[str, tuple[float, int]]:
        """Chi-square and degrees of freedom of each."""
        ends = np.cumsum([*self.sizes.values()]).tolist()
        places = {name: slice(end - size, end) for end, (name, size) in zip(ends, self.sizes.items(), strict=True)}
        tests = dict[str, tuple[float, int]].fromkeys(self.sizes, (nan, 0))
        for size in {*self.sizes.values()}:  # those of one size together take half the time
            names = [name for name in places if self.sizes[name] == size]
            blocks = np.stack([self.information[places[name], places[name]] for name in names])
            for name, values, axes in zip(names, *np.linalg.eigh(blocks), strict=True):
                seen = values > LEAST_PIVOT * values[-1]
                along = (axes.T @ self.score[places[name]])[seen]
                tests[name] = float(along @ (along / values[seen])), int(seen.sum())
        return tests

    @cached_property
    def deviations(self) -> dict[str, float]:
        """How far each chi-square lies above what is expected, 1-sigma; NaN before anything was seen."""
        tests = self._tests.items()
        return {name: deviation_of(chi_square / dof, dof) if dof else nan for name, (chi_square, dof) in tests}

    @cached_property
    def suspects(self) -> tuple[str, ...]:
        """What drifts if anything does, the most likely first; empty without an alarm."""
        if not any(deviation > ALARM_SIGMA for deviation in self.deviations.values()):
            return ()
        chi_squares = {name: chi_square for name, (chi_square, _) in self._tests.items()}
        least = LEAST_SHARE * max(chi_squares.values())
        named = [name for name, chi_square in chi_squares.items() if chi_square >= least]
        return tuple(sorted(named, key=lambda name: -chi_squares[name]))
