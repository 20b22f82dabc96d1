"""Means, of several lengths, of what rows are off their prediction, for monitors to compare (`monitors.py`).

A mean gives the newest value the weight dt / (dt + T); while it is younger than T it is that of all values.
"""

import math

from relnav.arrays import Record
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, select

FAST_S, MIDDLE_S, USUAL_S, SCATTER_S = 1.0, 5.0, 20.0, 3.0
"""Time constants of the means."""


@kernel
def _mean_share(share: float, weight: float) -> float:
    """Sum of squared weights of a mean after the next value."""
    return (1.0 - weight) * (1.0 - weight) * share + weight * weight


@kernel
def _next_share(share: float, weight: float, taken: bool, begun: bool) -> float:
    """The same where a value is taken; of the first it is 1."""
    return select(taken, select(begun, _mean_share(share, weight), 1.0), share)


@kernel
def take_value(group: Record, dt: float, taken: bool, learning: bool) -> None:
    """Carry the means of a group on, where it is taken; dt: s since it was seen last."""
    images = group["images"] + 1
    first, begun = 1.0 / images, images > 1
    fast, middle = max(first, dt / (dt + FAST_S)), max(first, dt / (dt + MIDDLE_S))
    value, noise, state = group["value"], group["noise"], group["state"]
    mean, longer, fast_state = group["fast"], group["middle"], group["fast_state"]
    squares = 0.0
    for k in range(group["rows"]):
        off = value[k] - mean[k]
        squares += off * off / (noise[k] * (1.0 + group["fast_share"]) + state[k] + fast_state[k])
    weight = max(1.0 / max(images - 1, 1), dt / (dt + SCATTER_S))
    scatter = group["scatter"] + weight * (squares / group["rows"] - group["scatter"])
    group["scatter"] = select(taken, select(begun, scatter, 1.0), group["scatter"])
    group["scatter_share"] = _next_share(group["scatter_share"], weight, taken, begun)
    group["fast_share"] = _next_share(group["fast_share"], fast, taken, begun)
    group["middle_share"] = _next_share(group["middle_share"], middle, taken, begun)
    group["images"] = select(taken, images, group["images"])
    for k in range(group["rows"]):
        mean[k] = select(taken, select(begun, mean[k] + fast * (value[k] - mean[k]), value[k]), mean[k])
        fast_state[k] = select(taken, fast_state[k] + fast * (state[k] - fast_state[k]), fast_state[k])
        longer[k] = select(taken, select(begun, longer[k] + middle * (value[k] - longer[k]), value[k]), longer[k])
    if anywhere(taken & learning):
        _learn(group, dt, taken & learning)


@kernel
def _learn(group: Record, dt: float, learns: bool) -> None:
    """Carry the older mean on, where it is learnt."""
    value, state, usual, usual_state = group["value"], group["state"], group["usual"], group["usual_state"]
    usual_white, usual_spread = group["usual_white"], group["usual_spread"]
    learnt = group["learnt"] + 1
    slow = max(1.0 / learnt, dt / (dt + USUAL_S))
    share = _mean_share(select(learnt > 1, group["usual_share"], 1.0), slow)
    group["usual_share"] = select(learns, share, group["usual_share"])
    group["learnt"], group["weight"] = select(learns, learnt, group["learnt"]), select(learns, slow, 0.0)
    for k in range(group["rows"]):
        white = (1.0 - slow) * (1.0 - slow) * usual_white[k] + slow * slow * state[k]
        spread = usual_spread[k] + slow * (math.sqrt(group["lasting"][k]) - usual_spread[k])
        usual[k] = select(learns, usual[k] + slow * (value[k] - usual[k]), usual[k])
        usual_state[k] = select(learns, usual_state[k] + slow * (state[k] - usual_state[k]), usual_state[k])
        usual_spread[k], usual_white[k] = select(learns, spread, usual_spread[k]), select(learns, white, usual_white[k])


@kernel
def newest_share(dt: float) -> float:
    """Weight of the newest value, dt s after the last, in the mean that `follow` carries on."""
    return dt / (dt + FAST_S)


@kernel
def follow(group: Record, k: int, share: float, seen: bool) -> float:
    """Carry the mean of a row's value on where it is seen, watched or not: where its next one will be."""
    offset = group["offset"]
    offset[k] = select(seen, offset[k] + share * (group["value"][k] - offset[k]), offset[k])
    return float(offset[k])
