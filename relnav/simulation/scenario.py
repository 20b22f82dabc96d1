"""A whole simulated log: truth, control and spots from one seed."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.mission import Model
from relnav.simulation.detector import Faults, image, spot_sigmas
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
    sigma_m : (n, 3, 2) or None
        1-sigma of each spot coordinate by received power, if the noise was drawn so.
    """

    t_s: Vector
    spots_m: Stack
    acceleration_m_s2: Matrix
    truth: Matrix
    sigma_m: Stack | None = None


def simulate(
    model: Model,
    approach: Approach | None = None,
    faults: Faults | None = None,
    seed: int = 0,
    *,
    by_received_power: bool = False,
) -> SimulatedLog:
    """Simulate an approach: two-body truth (optionally J2, drag) under closed-loop guidance, imaged with faults.

    The same seed gives the same log; trajectory and detector draw from streams of their own. Spot noise is the
    sensor's `spot_noise_m`, or what each beacon's received power makes it (needs [detector] and [light]).
    """
    flight, sensor = (np.random.default_rng(stream) for stream in np.random.SeedSequence(seed).spawn(2))
    t, truth, command = fly(model, approach or Approach(), flight)
    sigma = spot_sigmas(model, truth) if by_received_power else None
    return SimulatedLog(t, image(model, truth, faults or Faults(), sensor, sigma), command, truth, sigma)
