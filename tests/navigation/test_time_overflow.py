"""Times so far apart that their difference overflows: refused or survived, but never a hang."""

import os
import subprocess
import sys

import numpy as np
import pytest

import relnav

CODE = """
import numpy as np
import relnav
model = relnav.load_model("three_beacon_psd")
spots = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
t = np.array([-1.7e308, {second}])
try:
    {call}
except ValueError as error:
    print("refused:", error)
else:
    print("survived")
"""
CALLS = {
    "filter_epochs": "relnav.filter_epochs(model, t, np.tile(spots, (2, 1, 1)))",
    "Navigator": "navigator = relnav.Navigator(model); [navigator.step(s, spots) for s in t]",
}


@pytest.mark.parametrize("second", ["0.0", "1.7e308"])
@pytest.mark.parametrize("call", CALLS)
def test_a_step_that_is_no_number(call, second):
    command = [sys.executable, "-c", CODE.format(second=second, call=CALLS[call])]
    environment = os.environ | {"RELNAV_JIT": "0"}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=10)
    except subprocess.TimeoutExpired:
        pytest.fail("hangs: the time step overflows to infinity")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(("refused: ", "survived"))


def test_an_image_older_than_all_sense_is_too_late():
    navigator = relnav.PoseNavigator(relnav.load_model("three_marker_vision"))
    image = np.array([[469.3, 553.7], [553.7, 553.7], [511.5, 511.5]])
    for t in (0.1, 0.2):
        navigator.step(t, image)
    record = navigator.step(1e300, image, image_t_s=0.15, chaser_rate_rad_s=[1e9, 0.0, 0.0])
    assert record.too_late
