"""`Navigator.step` and a record's numbers, each one call of machine code, do what their lines of Python do."""

import copy
import gc
import inspect
import pickle
import struct
import sys
import tracemalloc
from itertools import combinations

import numpy as np
import pytest

import relnav
from relnav.codegen.kernel import is_compiled
from relnav.navigation.record import FilterRecord

pytestmark = pytest.mark.skipif(not is_compiled(), reason="kernels run as plain Python")

SPOTS = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
INPUTS = {
    "acceleration_m_s2": np.array([1e-4, -2e-4, 5e-5]),
    "delta_v_m_s": np.array([1e-3, 0.0, -1e-3]),
    "dcm_cam_from_lvlh": None,
    "spot_sigma_m": np.array([[2e-6, 3e-6], [np.nan, 2e-6], [4e-6, 4e-6]]),
    "attitude_noise_rad": 1e-4,
    "attitude_sigma_rad": 0.0,
}
NAMES = tuple(INPUTS)
CHOICES = [names for count in range(len(NAMES) + 1) for names in combinations(NAMES, count)]


@pytest.fixture(scope="module")
def model():
    return relnav.load_model("three_beacon_psd")


def in_python(navigator):
    """The method's own lines."""
    return relnav.Navigator.step.__get__(navigator)


def given(model, names):
    return {name: model.dcm_cam_from_lvlh if name == "dcm_cam_from_lvlh" else INPUTS[name] for name in names}


def outcome(call, *arguments, **named):
    """A record's bytes, or what was raised."""
    try:
        return call(*arguments, **named)._memory
    except Exception as error:  # compared with that of the other one
        return type(error), str(error)


@pytest.mark.parametrize("method", ["fix", "spots"])
def test_the_same_bits_whatever_is_told(model, method):
    fast, slow = relnav.Navigator(model, method), relnav.Navigator(model, method)
    assert type(fast.step.__func__).__name__ == "builtin_function_or_method"
    for k, names in enumerate(CHOICES):
        now, spots = 0.1 * k, SPOTS + 1e-7 * np.sin(k)
        record = fast.step(now, spots, **given(model, names))
        assert type(record) is FilterRecord
        assert record._memory == in_python(slow)(now, spots, **given(model, names))._memory
    assert record.has_state
    np.testing.assert_array_equal(fast._block, slow._block)


UNUSUAL = {
    "a list": ((1.0, SPOTS.tolist()), {}),
    "integers": ((1, SPOTS), {"acceleration_m_s2": [0, 0, 0]}),
    "by name": ((), {"t_s": 1.0, "spots_m": SPOTS}),
    "None": ((1.0, SPOTS), {"acceleration_m_s2": None, "image_t_s": None}),
    "its own time": ((1.0, SPOTS), {"image_t_s": 1.0}),
    "a name made at run time": ((1.0, SPOTS), {"".join(["delta", "_v_m_s"]): INPUTS["delta_v_m_s"]}),
    "nothing": ((), {}),
    "no spots": ((1.0,), {}),
    "three arguments": ((1.0, SPOTS, None), {}),
    "twice": ((1.0, SPOTS), {"t_s": 1.0}),
    "another name": ((1.0, SPOTS), {"acceleration": INPUTS["acceleration_m_s2"]}),
    "a time that does not advance": ((0.0, SPOTS), {}),
    "a time beyond floats": ((10**400, SPOTS), {}),
    "a text": (("soon", SPOTS), {}),
    "two spots": ((1.0, SPOTS[:2]), {}),
    "no number": ((1.0, SPOTS), {"acceleration_m_s2": np.array([np.nan, 0.0, 0.0])}),
    "an empty array": ((1.0, SPOTS), {"delta_v_m_s": np.empty(0)}),
    "no rotation": ((1.0, SPOTS), {"dcm_cam_from_lvlh": np.ones((3, 3))}),
    "a negative sigma": ((1.0, SPOTS), {"spot_sigma_m": -np.ones((3, 2))}),
    "a sigma whose square is infinite": ((1.0, SPOTS), {"spot_sigma_m": np.full((3, 2), 1e155)}),
    "an attitude's": ((1.0, SPOTS), {"attitude_noise_rad": 1e155}),
}


@pytest.mark.parametrize("case", UNUSUAL)
def test_what_is_unusual_is_left_to_python(model, case):
    arguments, named = UNUSUAL[case]
    fast, slow = relnav.Navigator(model), relnav.Navigator(model)
    for navigator in (fast, slow):
        navigator.step(0.0, SPOTS)
    assert outcome(fast.step, *arguments, **named) == outcome(in_python(slow), *arguments, **named)
    np.testing.assert_array_equal(fast._block, slow._block)


def test_help_shows_what_it_takes(model):
    step = relnav.Navigator(model).step
    assert list(inspect.signature(step).parameters) == list(inspect.signature(relnav.Navigator.step).parameters)[1:]
    assert inspect.getdoc(step) == inspect.getdoc(relnav.Navigator.step)


def test_copies_step_for_themselves(model):
    navigator = relnav.Navigator(model)
    other = copy.deepcopy(navigator)
    navigator.step(0.0, SPOTS)
    assert other.step(0.0, SPOTS).t_s == 0.0


@pytest.mark.parametrize("order", [("navigator", "step"), ("step", "navigator"), ("step",)])
def test_a_step_that_is_copied_is_that_of_the_copy(model, order):
    navigator, _ = started(model)
    held = {"navigator": navigator, "step": navigator.step}
    other = copy.deepcopy({name: held[name] for name in order})
    assert "navigator" not in other or other["step"] == other["navigator"].step
    assert other["step"](0.3, SPOTS)._memory == navigator.step(0.3, SPOTS)._memory
    with pytest.raises(ValueError, match="after the last step"):
        other["step"](0.3, SPOTS)


def test_a_step_apart_from_its_navigator(model):
    """A shallow copy steps the same one; bound to anything else it is the function of Python."""
    navigator, _ = started(model)
    assert copy.copy(navigator.step) == navigator.step
    assert repr(navigator) in repr(navigator.step)
    apart, record = navigator.step.__func__, in_python(copy.deepcopy(navigator))(0.3, SPOTS)
    assert apart(copy.deepcopy(navigator), 0.3, SPOTS)._memory == record._memory
    for arguments in ((), (navigator,), (3, 0.4, SPOTS)):
        assert outcome(apart, *arguments) == outcome(relnav.Navigator.step, *arguments)


def test_a_step_that_is_pickled_brings_its_navigator(model):
    navigator, _ = started(model)
    step = pickle.loads(pickle.dumps(navigator.step))
    assert step(0.3, SPOTS)._memory == navigator.step(0.3, SPOTS)._memory
    with pytest.raises(ValueError, match="after the last step"):
        step(0.3, SPOTS)


def test_a_class_of_ones_own_keeps_its_step(model):
    class Counting(relnav.Navigator):
        count = 0

        def step(self, *arguments, **named):
            self.count += 1
            return super().step(*arguments, **named)

    navigator = Counting(model)
    navigator.step(0.0, SPOTS)
    assert navigator.count == 1


def started(model):
    navigator = relnav.Navigator(model)
    for k in range(3):
        record = navigator.step(0.1 * k, SPOTS)
    return navigator, record


def test_numbers_and_arrays_of_a_record_are_those_of_its_bytes(model):
    _, record = started(model)
    for name, (place, shape) in FilterRecord.PLACES.items():
        expected = np.ndarray(shape, float, record._memory, place)
        got = getattr(record, name)
        assert isinstance(got, np.ndarray if shape else float)
        np.testing.assert_array_equal(got, expected)
        assert getattr(FilterRecord, name).fget.__name__ == name


def test_arrays_of_a_record_cannot_be_changed_and_outlive_it(model):
    navigator, record = started(model)
    state, kept = record.state, record.state.copy()
    with pytest.raises(ValueError, match="read-only"):
        state[0] = 1.0
    with pytest.raises(ValueError, match="cannot set WRITEABLE"):
        state.flags.writeable = True
    with pytest.raises(AttributeError):
        record.state = kept
    del record
    for k in range(3, 20):
        navigator.step(0.1 * k, SPOTS + 1e-6)
    gc.collect()
    np.testing.assert_array_equal(state, kept)


@pytest.mark.parametrize("name", ["t_s", "covariance"])
def test_what_is_no_record_is_refused(name):
    read = getattr(FilterRecord, name).fget
    with pytest.raises(AttributeError, match="_memory"):
        read(3)
    with pytest.raises((struct.error, TypeError), match="buffer"):
        read(FilterRecord(b"short"))


def test_nothing_is_left_behind(model):
    """Neither memory nor references of what is handed over, of what is refused, or of what is read."""
    navigator, record = started(model)
    acceleration, times = INPUTS["acceleration_m_s2"], iter(np.arange(1.0, 1e4, 0.1).tolist())

    def fly():
        for _ in range(300):
            record = navigator.step(next(times), SPOTS, acceleration_m_s2=acceleration)
            assert record.state[0] <= record.range_m < record.range_m + record.covariance[0, 0]
            outcome(navigator.step, 0.0, SPOTS)

    fly()
    counted = SPOTS, acceleration, None, True, FilterRecord, np.dtype(float), record._memory
    before = [sys.getrefcount(one) for one in counted]
    tracemalloc.start()
    fly()
    gc.collect()
    first = tracemalloc.get_traced_memory()[0]
    fly()
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - first
    tracemalloc.stop()
    assert grown < 300  # less than a byte a call
    now = [sys.getrefcount(one) for one in counted]
    assert all(abs(a - b) < 50 for a, b in zip(before, now, strict=True)), (before, now)
