"""What goes wrong with beacons: dead, fading, exchanged in their slots, or mirrored by something that shines."""

from dataclasses import dataclass

import numpy as np

from relnav.arrays import Codes, Matrix, Vector


@dataclass(frozen=True)
class BeaconFault:
    """One fault of one beacon (0, 1, 2) from a time on.

    Attributes
    ----------
    kind : {"dead", "fading", "swapped", "glint"}
        Off; losing power; shining in another one's slot and that one in its own; or partly mirrored.
    beacon : int
        Which.
    from_s : float
        From when.
    other : int
        Of "swapped": with which.
    time_constant_s : float
        Of "fading": power falls by e in this time.
    probability, share : float
        Of "glint": how many of its slots show a mirror image, somewhere on the detector, and how much of the light
        that is. A position-sensitive detector sees one spot, where the light is in the mean.
    """

    kind: str
    beacon: int
    from_s: float = 0.0
    other: int = 0
    time_constant_s: float = 100.0
    probability: float = 0.05
    share: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in ("dead", "fading", "swapped", "glint"):
            raise ValueError(f'kind is "dead", "fading", "swapped" or "glint"; got {self.kind!r}')
        if self.beacon not in (0, 1, 2) or self.other not in (0, 1, 2):
            raise ValueError(f"a beacon is 0, 1 or 2; got {self.beacon!r} and {self.other!r}")


def shining(faults: tuple[BeaconFault, ...], t_s: Vector) -> Matrix:
    """Power of each beacon over its nominal one, (n, 3)."""
    out = np.ones((len(t_s), 3))
    for fault in faults:
        late = np.maximum(t_s - fault.from_s, 0.0)
        if fault.kind == "dead":
            out[t_s >= fault.from_s, fault.beacon] = 0.0
        elif fault.kind == "fading":
            out[:, fault.beacon] *= np.exp(-late / fault.time_constant_s)
    return out


def in_slot(faults: tuple[BeaconFault, ...], t_s: Vector, beacon: Codes) -> Codes:
    """Which beacon really shines in slots meant for `beacon` (n,)."""
    out = beacon.copy()
    for fault in faults:
        if fault.kind == "swapped":
            late = t_s >= fault.from_s
            out[late & (beacon == fault.beacon)] = fault.other
            out[late & (beacon == fault.other)] = fault.beacon
    return out


def mirrored(
    faults: tuple[BeaconFault, ...], t_s: Vector, spots_m: Matrix, half_m: Vector, rng: np.random.Generator
) -> Matrix:
    """Spots (n, 3, 2) m where the light is in the mean, with mirror images."""
    out = spots_m.copy()
    for fault in faults:
        if fault.kind == "glint":
            hit = (t_s >= fault.from_s) & (rng.uniform(size=len(t_s)) < fault.probability)
            image = rng.uniform(-1.0, 1.0, size=(len(t_s), 2)) * half_m
            out[hit, fault.beacon] = (1.0 - fault.share) * out[hit, fault.beacon] + fault.share * image[hit]
    return out
