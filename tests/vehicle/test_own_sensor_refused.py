"""A sensor of one's own that states or returns what cannot be: refused in one sentence, and the filter is as it was."""

import dataclasses

import numpy as np
import pytest

from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.layout import LastingError
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.replay import Observed
from relnav.vehicle.rows import Rows

NOISE_M, OFFSET_M = 0.03, 0.1


class Place:
    """Where the chaser is, `lvlh_ccsds`, off by a constant; what it returns is then changed."""

    lasting, most_rows = (LastingError("offset", 3, OFFSET_M),), 3

    def __init__(self, change=lambda rows: rows, **other):
        self.change = change
        self.__dict__.update(other)

    def placed(self, name, layout):
        self.offset, self.position = layout.by_name.get(f"{name}.offset", slice(0, 0)), layout.by_name["position"]
        self.size = layout.size

    def taken(self, value, _):
        return np.array(value, dtype=float), NOISE_M**2 * np.eye(3)

    def rows(self, state, value, noise):
        H = np.zeros((3, self.size))
        H[:, self.position] = H[:, self.offset] = np.eye(3)
        return self.change(Rows(value - state.values[self.position] - state.values[self.offset], H, noise, 3))


def but(**changes):
    """The same rows with these parts replaced, or made anew from what is there."""

    def change(rows):
        made = {key: new(getattr(rows, key)) if callable(new) else new for key, new in changes.items()}
        return dataclasses.replace(rows, **made)

    return change


def times(k):
    """The same rows k times."""
    return but(
        residual=lambda r: np.tile(r, k),
        jacobian=lambda H: np.tile(H, (k, 1)),
        noise=lambda R: np.kron(np.eye(k), R),
    )


def skewed(R):
    R = R.copy()
    R[0, 1] = 0.9 * R[0, 0]
    return R


def some(place, value):
    """An array with one number changed."""

    def change(array):
        array = array.copy()
        array[place] = value
        return array

    return change


WRONG_ROWS = {
    "too many": (times(2), r"residuals \(m,\) with m up to its most_rows, 3: state as many; got shape \(6,\)"),
    "far too many": (times(200), r"got shape \(600,\)"),
    "scalar residual": (but(residual=0.1), r"residuals .* got shape \(\)"),
    "short jacobian": (but(jacobian=lambda H: H[:, :10]), r"a jacobian \(3, 78\): .* got shape \(3, 10\)"),
    "flat jacobian": (but(jacobian=lambda H: H[0]), r"a jacobian \(3, 78\): .* got shape \(78,\)"),
    "flat noise": (but(noise=np.diag), r"a noise \(3, 3\): the whole covariance .* got shape \(3,\)"),
    "scalar noise": (but(noise=NOISE_M**2), r"a noise \(3, 3\): .* got shape \(\)"),
    "group of 0": (but(group=0), r"groups of 1 to 3 that divide their number, 3; got a group of 0"),
    "group of 2": (but(group=2), r"got a group of 2"),
    "group of 5": (but(group=5), r"got a group of 5"),
    "group of 1.5": (but(group=1.5), r"got a group of 1.5"),
    "infinite residual": (but(residual=some(1, np.inf)), r"finite numbers, or a residual of NaN .*; got infinite"),
    "jacobian of NaN": (but(jacobian=some((2, 0), np.nan)), r"finite numbers"),
    "noise of NaN": (but(noise=some((0, 0), np.nan)), r"finite numbers"),
    "no noise": (but(noise=np.zeros_like), r"a noise with variances above zero; got \[0.0, 0.0, 0.0\]"),
    "negative noise": (but(noise=np.negative), r"a noise with variances above zero; got \[-0.0009"),
    "skewed noise": (but(noise=skewed), r"a noise that is symmetric, with correlations up to one; got"),
    "noise beyond one": (but(noise=lambda R: R + 1.1 * R[0, 0] * (1.0 - np.eye(3))), r"correlations up to one; got"),
    "a tuple": (lambda rows: (rows.residual, rows.jacobian, rows.noise, 3), r"a relnav.vehicle.rows.Rows; got a tuple"),
}


@pytest.fixture(scope="module")
def run(near):
    """Two seconds and a half."""
    return simulate_rendezvous(near, Rendezvous(start_m=5.6, final_m=5.5), seed=3)


@pytest.fixture(scope="module")
def begun(run):
    """A second of it."""
    return [one for one in run.observations if one.t_s < 1.0]


def flown(vehicle, observations, sensor):
    nav = VehicleNavigator(vehicle, sensors={"gps": sensor})
    for one in observations:
        nav.observe(one.sensor, one.t_s, one.value)
    return nav


def place(run, t_s):
    return run.truth.motion(np.array([t_s]))[0, :3]


@pytest.mark.parametrize("kind", WRONG_ROWS)
def test_rows(near, run, begun, kind):
    """Late ones, which are inserted before others, and current ones; what was seen before and after stands."""
    change, said = WRONG_ROWS[kind]
    nav = flown(near, begun, Place(change))
    for t_s in (0.7, 1.1):
        with pytest.raises(ValueError, match=r"^sensors: rows\(\) of 'gps' returns .*" + said):
            nav.observe("gps", t_s, place(run, t_s))
    never = flown(near, begun, Place())
    for one in run.observations:
        if 1.0 <= one.t_s < 1.5:
            for each in nav, never:
                each.observe(one.sensor, one.t_s, one.value)
    assert nav.state().values.tobytes() == never.state().values.tobytes()
    assert nav.state().covariance.tobytes() == never.state().covariance.tobytes()


def test_rows_of_another_size_in_the_second_filter(near, run, begun):
    """Each of the two filters asks at its own estimate."""
    asked = []

    def change(rows):
        asked.append(rows)
        return dataclasses.replace(rows, group=3 if len(asked) % 2 else 1)

    nav = flown(near, begun, Place(change))
    with pytest.raises(ValueError, match="groups of the same size at every estimate; got 1 and 3"):
        nav.observe("gps", 1.1, place(run, 1.1))


RIGHT_ROWS = {
    "as many as most_rows": (times(4), {"most_rows": 12}),
    "in groups of one": (but(group=1), {}),
    "single precision": (but(noise=lambda R: (R + 0.5 * R[0, 0]).astype("f4")), {}),
    "correlated": (but(noise=lambda R: R + 0.999 * R[0, 0] * (1.0 - np.eye(3))), {}),
    "fewer": (lambda rows: Rows(rows.residual[:1], rows.jacobian[:1], rows.noise[:1, :1], 1), {}),
    "one of them not seen": (
        but(residual=some(1, np.nan), jacobian=some(1, np.nan), noise=some((1, slice(None)), np.nan), group=1),
        {},
    ),
}


@pytest.mark.parametrize("kind", RIGHT_ROWS)
def test_rows_that_are_right(near, run, begun, kind):
    change, more = RIGHT_ROWS[kind]
    nav = flown(near, begun, Place(change, **more))
    before = nav.state(1.1).covariance
    assert nav.observe("gps", 1.1, place(run, 1.1)) is Observed.ACCEPTED
    after = nav.state().covariance
    assert np.isfinite(after).all()
    assert np.linalg.eigvalsh(after).min() > 0.0
    offset = nav.layout.by_name["gps.offset"]
    assert after[offset, offset][0, 0] < before[offset, offset][0, 0]


def test_nothing_seen(near, run, begun):
    nav = flown(near, begun, Place(but(residual=lambda r: r * np.nan, jacobian=lambda H: H * np.nan)))
    assert nav.observe("gps", 1.1, place(run, 1.1)) is Observed.REJECTED


@pytest.mark.parametrize(
    "taken",
    [
        np.zeros(3),
        (np.zeros(3), None),
        ([0.0, 0.0, 0.0], np.eye(3)),
        (np.zeros((1, 3)), np.eye(3)),
    ],
)
def test_what_is_taken(near, taken):
    nav = flown(near, [], Place(taken=lambda *_: taken))
    with pytest.raises(ValueError, match=r"^sensors: taken\(\) of 'gps' returns two arrays, numbers \(k,\) and the"):
        nav.observe("gps", 0.1, [0.0, 0.0, 0.0])


def off(*errors):
    return Place(lasting=errors)


WRONG_SENSORS = {
    "class": (Place, r"an object with lasting, .*; got a class, Place: call it"),
    "object": (object(), r"an object with lasting, .*; got none of lasting, most_rows, placed, taken, rows"),
    "no rows": (Place(most_rows=0), "most_rows, a whole number above zero; got 0"),
    "half a row": (Place(most_rows=1.5), "most_rows, a whole number above zero; got 1.5"),
    "one": (Place(lasting=LastingError("offset", 3, 0.1)), "a sequence of LastingError; got a LastingError"),
    "text": (Place(lasting=("offset",)), "LastingError alone; got a str"),
    "twice": (off(LastingError("a", 3, 0.1), LastingError("a", 3, 0.1)), "different kinds; got two 'a'"),
    "nameless": (off(LastingError("", 3, 0.1)), "a kind that is text without a dot; got ''"),
    "dot": (off(LastingError("a.b", 3, 0.1)), "a kind that is text without a dot; got 'a.b'"),
    "no size": (off(LastingError("a", 0, 0.1)), "'a' a size above zero, .*; got 0"),
    "part": (off(LastingError("a", 1.5, 0.1)), "'a' a size above zero, .*; got 1.5"),
    "lights": (off(LastingError("points", 4, 0.1)), "of 'points' three a light; got 4"),
    "below zero": (off(LastingError("a", 3, -0.1)), "'a' a sigma that is one number, zero or more; got -0.1"),
    "NaN": (off(LastingError("a", 3, np.nan)), "'a' a sigma .*; got nan"),
    "infinite": (off(LastingError("a", 3, np.inf)), "'a' a sigma .*; got inf"),
    "three": (off(LastingError("a", 3, np.ones(3))), r"'a' a sigma .*; got array"),
    "role": (off(LastingError("a", 3, 0.1, "guessed")), "'a' the role 'estimated' or 'considered'; got 'guessed'"),
}


@pytest.mark.parametrize("kind", WRONG_SENSORS)
def test_sensors(vehicle, kind):
    sensor, said = WRONG_SENSORS[kind]
    with pytest.raises(ValueError, match="^sensors: 'gps' has to have .*" + said):
        VehicleNavigator(vehicle, sensors={"gps": sensor})


@pytest.mark.parametrize("name", ["", "a.b", 3])
def test_names(vehicle, name):
    with pytest.raises(ValueError, match="has to have a name that is text without a dot"):
        VehicleNavigator(vehicle, sensors={name: Place()})


@pytest.mark.parametrize("sensors", [[3], [], "lidar", Place()])
def test_without_names(vehicle, sensors):
    with pytest.raises(
        ValueError, match=r"^sensors: a mapping of names to sensors is expected; got a (list|str|Place)$"
    ):
        VehicleNavigator(vehicle, sensors=sensors)


def test_a_list_of_errors_and_none_will_do(vehicle):
    for lasting, size in (([LastingError("offset", 3, 0.1)], 78), ((LastingError("points", 6, 0.0),), 81), ((), 75)):
        assert VehicleNavigator(vehicle, sensors={"gps": Place(lasting=lasting)}).layout.size == size
