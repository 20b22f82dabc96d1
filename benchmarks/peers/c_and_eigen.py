"""The filter of `by_hand` in plain C and in C++ with Eigen, compiled here and now: called from Python and from C."""

import ctypes
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path

import numpy as np

SOURCES = Path(__file__).parent / "compiled"
FLAGS = ("-O3", "-march=native", "-fPIC", "-shared")
ANSWER = 43
EIGEN = (
    Path("/usr/include/eigen3"),
    Path("/usr/local/include/eigen3"),
    Path(sysconfig.get_path("purelib"), "cmeel.prefix", "include", "eigen3"),  # PyPI's cmeel-eigen
)


def libraries():
    """Language -> library with `one_epoch` and `many_epochs`; what cannot be compiled is left out with a sentence."""
    found = {}
    if (compiler := shutil.which("cc")) is None:
        print("plain C is left out: there is no C compiler cc on the path")
    else:
        found["plain C"] = compiled(compiler, "filter.c", ("-lm",))
    headers = next((folder for folder in EIGEN if (folder / "Eigen" / "Dense").is_file()), None)
    if (compiler := shutil.which("c++")) is None:
        print("C++ with Eigen is left out: there is no C++ compiler c++ on the path")
    elif headers is None:
        print("C++ with Eigen is left out, no headers of Eigen: apt install libeigen3-dev, or pip install cmeel-eigen")
    else:
        found["C++ with Eigen"] = compiled(compiler, "filter.cpp", ("-std=c++17", f"-I{headers}"))
    return found


def compiled(compiler, source, options):
    """A source as a library of this process."""
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, "filter.so")
        subprocess.run([compiler, *FLAGS, SOURCES / source, *options, "-o", library], check=True)
        loaded = ctypes.CDLL(library)
    pointer = ctypes.c_void_p
    loaded.one_epoch.argtypes = [pointer] * 4
    loaded.many_epochs.argtypes = [pointer, ctypes.c_long, *[pointer] * 3]
    loaded.one_epoch.restype = loaded.many_epochs.restype = None
    return loaded


def memory(start):
    """The filter's memory as `compiled/filter.h` has it."""
    hand = start.hand
    numbers = [hand.f, hand.s, hand.a, hand.b, start.gate]
    matrices = hand.beacons, hand.dock, hand.cam_from_dock, start.phi, start.q, start.effect, start.x, start.covariance
    return np.concatenate([numbers, *(np.ravel(m) for m in matrices)])


class FromPython:
    """An epoch a call, by ctypes."""

    def __init__(self, library, start):
        """Start the filter."""
        self.memory, self.answer, self.call = memory(start), np.empty(ANSWER), library.one_epoch
        self.places = self.memory.ctypes.data, self.answer.ctypes.data

    def step(self, spots, acceleration):
        """Range, state, covariance after one image; spots (3, 2) and acceleration (3,) lie row by row."""
        filter_, answer = self.places
        self.call(filter_, spots.ctypes.data, acceleration.ctypes.data, answer)
        read = self.answer.copy()
        return read[0], read[1:7], read[7:].reshape(6, 6)


def from_a_loop_in_c(library, start, spots, accelerations):
    """Ranges (n,), states (n, 6), covariances (n, 6, 6) of images (n, 3, 2), the loop and its answers in C."""
    filter_, answers = memory(start), np.empty((len(spots), ANSWER))
    images = filter_.ctypes.data, len(spots), spots.ctypes.data, accelerations.ctypes.data
    library.many_epochs(*images, answers.ctypes.data)
    return answers[:, 0], answers[:, 1:7], answers[:, 7:].reshape(-1, 6, 6)
