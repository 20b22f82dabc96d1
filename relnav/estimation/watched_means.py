"""Means, of several lengths, of what rows are off their prediction, for monitors to compare (`monitors.py`).

A mean gives the newest value the weight dt / (dt + T); while it is younger than T it is that of all values.
"""

import math

from relnav.arrays import Record
from relnav.codegen.kernel import kernel
from relnav.codegen.together import anywhere, held, select

FAST_S, MIDDLE_S, USUAL_S, SCATTER_S = 1.0, 5.0, 20.0, 3.0
"""Time constants of the means."""


@kernel
def _white(carried: float, weight: float, newest: float) -> float:
    """Variance of a mean after the next value, both of them white: a sum with squared weights."""
    return (1.0 - weight) * (1.0 - weight) * carried + weight * weight * newest


@kernel
def take_value(group: Record, dt: float, taken: bool, learning: bool) -> None:
    """Carry the means of a group on, where it is taken; dt: s since it was seen last."""
    images = group["images"] + 1
    first, begun = 1.0 / images, images > 1
    fast, middle = max(first, dt / (dt + FAST_S)), max(first, dt / (dt + MIDDLE_S))  # of the first value: 1
    value, noise, state = group["value"], group["noise"], group["state"]
    mean, longer, fast_state = group["fast"], group["middle"], group["fast_state"]
    fast_noise, middle_noise = group["fast_noise"], group["middle_noise"]
    fast_white, middle_white = group["fast_white"], group["middle_white"]
    moved, squares, lasting, whole = group["moved"], 0.0, 0.0, 0.0
    for k in range(group["rows"]):
        off, variance = value[k] - mean[k], noise[k] + fast_noise[k] + state[k] + fast_state[k] + moved[k]
        squares += off * off / variance
        lasting, whole = lasting + moved[k], whole + variance
    weight = max(1.0 / max(images - 1, 1), dt / (dt + SCATTER_S))
    scatter = group["scatter"] + weight * (squares / group["rows"] - group["scatter"])
    group["scatter"] = select(taken, select(begun, scatter, 1.0), group["scatter"])
    shown = group["scatter_moved"] + weight * (lasting / whole - group["scatter_moved"])
    group["scatter_moved"] = select(taken, select(begun, shown, 0.0), group["scatter_moved"])
    share = select(begun, _white(group["scatter_share"], weight, 1.0), 1.0)
    group["scatter_share"] = select(taken, share, group["scatter_share"])
    group["images"], group["fast_weight"] = select(taken, images, group["images"]), select(taken, fast, 0.0)
    for k in range(group["rows"]):
        mean[k] = select(taken, select(begun, mean[k] + fast * (value[k] - mean[k]), value[k]), mean[k])
        fast_noise[k] = select(taken, _white(fast_noise[k], fast, noise[k]), fast_noise[k])
        fast_white[k] = select(taken, _white(fast_white[k], fast, state[k]), fast_white[k])
        fast_state[k] = select(taken, fast_state[k] + fast * (state[k] - fast_state[k]), fast_state[k])
        longer[k] = select(taken, select(begun, longer[k] + middle * (value[k] - longer[k]), value[k]), longer[k])
        middle_white[k] = select(taken, _white(middle_white[k], middle, state[k]), middle_white[k])
        middle_noise[k] = select(taken, _white(middle_noise[k], middle, noise[k]), middle_noise[k])
    if anywhere(taken & learning):
        _learn(group, dt, held(taken & learning))


@kernel
def _learn(group: Record, dt: float, learns: bool) -> None:
    """Carry the older mean on, where it is learnt."""
    value, noise, state, usual = group["value"], group["noise"], group["state"], group["usual"]
    usual_noise, usual_state = group["usual_noise"], group["usual_state"]
    usual_white, usual_spread = group["usual_white"], group["usual_spread"]
    learnt = group["learnt"] + 1
    slow = max(1.0 / learnt, dt / (dt + USUAL_S))
    group["learnt"], group["weight"] = select(learns, learnt, group["learnt"]), select(learns, slow, 0.0)
    for k in range(group["rows"]):
        spread = usual_spread[k] + slow * (math.sqrt(group["lasting"][k]) - usual_spread[k])
        usual[k] = select(learns, usual[k] + slow * (value[k] - usual[k]), usual[k])
        usual_noise[k] = select(learns, _white(usual_noise[k], slow, noise[k]), usual_noise[k])
        usual_state[k] = select(learns, usual_state[k] + slow * (state[k] - usual_state[k]), usual_state[k])
        usual_white[k] = select(learns, _white(usual_white[k], slow, state[k]), usual_white[k])
        usual_spread[k] = select(learns, spread, usual_spread[k])


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
