"""Where every peer of a call with its answer starts from."""

from dataclasses import dataclass

import numpy as np

from peers.by_hand import ByHand


@dataclass(frozen=True)
class Start:
    """State (6,), covariance (6, 6), transition, its noise, effect (6, 3) of an acceleration; limit of NIS."""

    hand: ByHand
    x: np.ndarray
    covariance: np.ndarray
    phi: np.ndarray
    q: np.ndarray
    effect: np.ndarray
    gate: float

    def seen(self, x, spots):
        """Of one image and a predicted state: innovation (3,), its rows H (3, 6) and noise R (3, 3), with numpy."""
        hand = self.hand
        predicted, h, r = hand.measurement(x)
        return hand.residual(hand.angles(hand.closed_form(spots)), predicted), h, r
