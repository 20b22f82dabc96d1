"""Random numbers that depend on what they are for alone: on seed, run, stream and place, not on what was drawn before.

Philox4x64 with ten rounds (Salmon, Moraes, Dror, Shaw 2011, "Parallel random numbers: as easy as 1, 2, 3") turns a
counter of four words into four random ones under a key of two: key = (seed, run), counter = (block, 0, 0, stream).
Different keys are different random functions, so no two runs of any two campaigns share numbers. Words are those of
`numpy.random.Philox(key=[seed, run], counter=[0, 0, 0, stream]).random_raw()`. Every number takes one word, so that the
n-th of a stream is the n-th word of it, whether or not the others are wanted.
"""

import math
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from relnav.arrays import Codes, Vector, whole
from relnav.codegen.kernel import kernel, long_kernel
from relnav.codegen.words import whole_product, wrapped_sum

ROUNDS = 10
FIRST_FACTOR, SECOND_FACTOR = 0xD2E7470EE14C6C93, 0xCA5A826395121157
FIRST_WEYL, SECOND_WEYL = 0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B
SMALLEST_STEP = 2.0**-52
MIDDLE = 0.425
"""Shares of 0.5 up to so far aside are the middle of the normal distribution, the others its tails."""

Words = NDArray[np.uint64]


class Stream(IntEnum):
    """What random numbers of a run are for. A number once given stays: it is part of every result."""

    START = 0
    """Where and how fast the chaser starts."""
    THRUST = 1
    """Errors of the thrusters that last, and the profile's."""
    MOTION = 2
    """White acceleration of every interval."""
    SPOT_NOISE = 3
    """Of every spot coordinate."""
    DROPOUT = 4
    """Whether a spot is unseen."""
    GLINT = 5
    """Whether a spot is elsewhere."""
    GLINT_PLACE = 6
    """Where it then is."""
    BUILT = 7
    """Focal length, mountings and beacons as they were built."""
    FIGURE = 8
    """What a calibration leaves."""
    LOSS = 9
    """Whether a beacon or marker is lost, or a sensor of a vehicle at fault, in this run."""
    TURN = 10
    """How the target of a marker mission is turned and turns at the start, and the chaser's attitude error."""
    TORQUE = 11
    """What disturbs its rotation."""
    ATTITUDE_NOISE = 12
    """Of the chaser's attitude, image by image."""
    DESIGN = 13
    """What is drawn once, where sensitivities are asked for."""
    INERTIA = 14
    """By how much the inertia of a marker mission's target is off."""
    VEHICLE_ONCE = 16
    """What is drawn once a run of every vehicle (`vehicle_numbers.ONCE`)."""
    VEHICLE_ANGLES = 17
    """Phases of its sway, and of the true orbit."""
    VEHICLE_MOTION = 18
    """White accelerations."""
    VEHICLE_SLOW = 19
    """The slow acceleration, where truth is as believed."""
    GYRO = 20
    """Walk of the gyro's bias, and its noise."""
    FAULT = 21
    """What a sensor's fault looks like."""
    SENSORS = 64
    """The first sensor's noise; with what it is built from the next on (`vehicle_numbers.BUILT`), 8 for each sensor."""


@kernel
def _block(first: int, second: int, stream: int, counter: int) -> tuple[int, int, int, int]:
    """The four words of a block, under the key (first, second): seed and run."""
    a, b, c, d = counter, first ^ first, first ^ first, stream
    for _ in range(ROUNDS):
        up, low = whole_product(a, FIRST_FACTOR)
        up_too, low_too = whole_product(c, SECOND_FACTOR)
        a, b, c, d = up_too ^ b ^ first, low_too, up ^ d ^ second, low
        first, second = wrapped_sum(first, FIRST_WEYL), wrapped_sum(second, SECOND_WEYL)
    return a, b, c, d


@kernel
def _share(word: int) -> float:
    """A word as a number between 0 and 1, neither of them included."""
    return (np.float64(word >> 12) + 0.5) * SMALLEST_STEP


@kernel
def _middle(q: float) -> float:
    """Normal deviate of the share 0.5 + q, where |q| <= MIDDLE; relative error 1e-16.

    This, `_tail` and `_far_tail`: Wichura (1988), "Algorithm AS 241: the percentage points of the normal
    distribution", PPND16.
    """
    r = 0.180625 - q * q
    above = 2.5090809287301226727e3 * r + 3.3430575583588128105e4
    above = (above * r + 6.7265770927008700853e4) * r + 4.5921953931549871457e4
    above = (above * r + 1.3731693765509461125e4) * r + 1.9715909503065514427e3
    above = (above * r + 1.3314166789178437745e2) * r + 3.3871328727963666080e0
    below = 5.2264952788528545610e3 * r + 2.8729085735721942674e4
    below = (below * r + 3.9307895800092710610e4) * r + 2.1213794301586595867e4
    below = (below * r + 5.3941960214247511077e3) * r + 6.8718700749205790830e2
    below = (below * r + 4.2313330701600911252e1) * r + 1.0
    return q * above / below


@kernel
def _root(p: float) -> float:
    """Of what the tails are rational functions, for the share p."""
    return math.sqrt(-math.log(min(p, 1.0 - p)))


@kernel
def _tail(r: float) -> float:
    """Size of the normal deviate of a share elsewhere, r = `_root` <= 5: 1.4e-11 and more from 0 and 1."""
    r -= 1.6
    above = 7.74545014278341407640e-4 * r + 2.27238449892691845833e-2
    above = (above * r + 2.41780725177450611770e-1) * r + 1.27045825245236838258e0
    above = (above * r + 3.64784832476320460504e0) * r + 5.76949722146069140550e0
    above = (above * r + 4.63033784615654529590e0) * r + 1.42343711074968357734e0
    below = 1.05075007164441684324e-9 * r + 5.47593808499534494600e-4
    below = (below * r + 1.51986665636164571966e-2) * r + 1.48103976427480074590e-1
    below = (below * r + 6.89767334985100004550e-1) * r + 1.67638483018380384940e0
    below = (below * r + 2.05319162663775882187e0) * r + 1.0
    return above / below


@kernel
def _far_tail(r: float) -> float:
    """The same of r > 5."""
    r -= 5.0
    above = 2.01033439929228813265e-7 * r + 2.71155556874348757815e-5
    above = (above * r + 1.24266094738807843860e-3) * r + 2.65321895265761230930e-2
    above = (above * r + 2.96560571828504891230e-1) * r + 1.78482653991729133580e0
    above = (above * r + 5.46378491116411436990e0) * r + 6.65790464350110377720e0
    below = 2.04426310338993978564e-15 * r + 1.42151175831644588870e-7
    below = (below * r + 1.84631831751005468180e-5) * r + 7.86869131145613259100e-4
    below = (below * r + 1.48753612908506148525e-2) * r + 1.36929880922735805310e-1
    below = (below * r + 5.99832206555887937690e-1) * r + 1.0
    return above / below


@kernel
def _sizes(roots: Vector) -> None:
    """Replace what `_root` says of tails (n,) by their sizes."""
    farthest = 0.0
    for j in range(roots.shape[0]):
        farthest = max(farthest, roots[j])
    if farthest > 5.0:  # because of one number in 3.6e10
        for j in range(roots.shape[0]):
            roots[j] = _far_tail(roots[j]) if roots[j] > 5.0 else _tail(roots[j])
    else:
        for j in range(roots.shape[0]):
            roots[j] = _tail(roots[j])


@long_kernel
def _uniforms_into(key: Words, out: Vector) -> None:
    """Fill out (n,) with numbers between 0 and 1, neither of them included; key: seed, run, stream, 1, 0."""
    n, one, counter = out.shape[0], key[3], key[4]
    for block in range(n // 4):  # nothing of a block waits for the one before
        counter = wrapped_sum(counter, one)
        a, b, c, d = _block(key[0], key[1], key[2], counter)
        out[4 * block], out[4 * block + 1] = _share(a), _share(b)
        out[4 * block + 2], out[4 * block + 3] = _share(c), _share(d)
    left = n % 4
    if left > 0:
        a, b, c, _ = _block(key[0], key[1], key[2], wrapped_sum(counter, one))
        out[n - left] = _share(a)
        if left > 1:
            out[n - left + 1] = _share(b)
        if left > 2:
            out[n - left + 2] = _share(c)


@long_kernel
def _below(key: Words, limit: int, n: int, places: Codes) -> int:
    """Write which of the first n numbers of a stream are below a limit, 2^52 times a probability; returns how many.

    places (n + 4,); key as above. Which they are a processor cannot guess: each is written, and kept or written over.
    """
    count, one, counter = 0, key[3], key[4]
    for block in range((n + 3) // 4):
        counter = wrapped_sum(counter, one)
        a, b, c, d = _block(key[0], key[1], key[2], counter)
        for k, word in enumerate((a, b, c, d)):
            places[count] = 4 * block + k
            count += 1 if np.int64(word >> 12) < limit else 0
    while count > 0 and places[count - 1] >= n:
        count -= 1
    return count


@long_kernel
def _uniforms_at(key: Words, places: Codes, out: Vector) -> None:
    """Fill out (n,) with the numbers of these places of a stream alone; key as above."""
    for k in range(out.shape[0]):
        a, b, c, d = _block(key[0], key[1], key[2], wrapped_sum(key[3], places[k] // 4))
        place = places[k] % 4
        out[k] = _share(a if place == 0 else b if place == 1 else c if place == 2 else d)


@long_kernel
def _normals_into(key: Words, uniform: Vector, tails: Codes, size: Vector, out: Vector) -> None:
    """Fill out (n,) with standard normal numbers; uniform (n,), tails (n + 1,) and size (n,) are scratch.

    Loops without choices, of which the compiler makes one instruction for several numbers; tails are gathered, because
    a processor cannot guess where they are.
    """
    _uniforms_into(key, uniform)
    for k in range(out.shape[0]):
        out[k] = _middle(uniform[k] - 0.5)
    count = 0
    for k in range(out.shape[0]):
        tails[count] = k
        count += 1 if abs(uniform[k] - 0.5) > MIDDLE else 0
    for j in range(count):
        size[j] = _root(uniform[tails[j]])
    _sizes(size[:count])
    for j in range(count):
        k = tails[j]
        out[k] = -size[j] if uniform[k] < 0.5 else size[j]


class Draws:
    """The random numbers of one run, stream by stream.

    seed, run: 0 or more, below 2^64.
    """

    def __init__(self, seed: int, run: int) -> None:
        for name, value in (("seed", seed), ("run", run)):
            whole(name, value)
        self._key = np.array([seed, run, 0, 1, 0], dtype=np.uint64)

    def uniforms(self, stream: int, shape: tuple[int, ...]) -> Vector:
        """The first numbers of a stream, between 0 and 1."""
        out, self._key[2] = np.empty(math.prod(shape)), stream
        _uniforms_into(self._key, out)
        return out.reshape(shape)

    def below(self, stream: int, count: int, probability: float) -> Codes:
        """Places, among the first `count` numbers of a stream, of those below a probability."""
        places, self._key[2] = np.empty(count + 4, dtype=np.int64), stream
        limit = math.ceil(probability / SMALLEST_STEP - 0.5)  # (word + 0.5) SMALLEST_STEP < probability; exact
        return places[: _below(self._key, limit, count, places)]

    def uniforms_at(self, stream: int, places: Codes) -> Vector:
        """Numbers of a stream by their places (n,) in it, counted from 0."""
        out, self._key[2] = np.empty(len(places)), stream
        _uniforms_at(self._key, places, out)
        return out

    def normals(self, stream: int, shape: tuple[int, ...]) -> Vector:
        """The same as standard normal numbers."""
        out, self._key[2] = np.empty(math.prod(shape)), stream
        uniform, size = np.empty((2, len(out)))
        _normals_into(self._key, uniform, np.empty(len(out) + 1, dtype=np.int64), size, out)
        return out.reshape(shape)

    def generator(self, stream: int) -> np.random.Generator:
        """A generator of numpy on a stream, for what is drawn in no fixed number."""
        return np.random.Generator(np.random.Philox(key=self._key[:2], counter=[0, 0, 0, int(stream)]))
