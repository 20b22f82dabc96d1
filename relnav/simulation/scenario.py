"""A whole simulated log: truth, control and spots from one seed."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Model
from relnav.simulation.detector import Faults, image
from relnav.simulation.trajectory import Approach, fly


@dataclass(frozen=True)
class SimulatedLog:
    """A log and its truth, SI units, `lvlh_ccsds`.

    Attributes
    ----------
    t_s, spots_m, acceleration_m_s2 : (n,), (n, 3, 2), (n, 3)
        The log; NaN = not seen; acceleration as commanded, held over the interval that ends at the row.
    truth : (n, 6)
        True relative states.
    """

    t_s: Vector
    spots_m: Stack
    acceleration_m_s2: Matrix
    truth: Matrix


def simulate(
    model: Model, approach: Approach | None = None, faults: Faults | None = None, seed: int = 0
) -> SimulatedLog:
    """Simulate an approach: two-body truth (optionally J2, drag) under closed-loop guidance, imaged with faults.

    The same seed gives the same log; trajectory and detector draw from streams of their own.
    """
    flight, sensor = (np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(2))
    t, truth, command = fly(model, approach or Approach(), flight)
    return SimulatedLog(t, image(model, truth, faults or Faults(), sensor), command, truth)
