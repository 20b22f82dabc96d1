"""The filter of `by_hand` in plain C and in C++ with Eigen, compiled here and now: called from Python and from C."""

import ctypes
import functools
import importlib.machinery
import importlib.util
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
PYTHON = Path(sysconfig.get_path("include"))


def libraries(folder):
    """Language -> library with `one_epoch` and `many_epochs`; what cannot be compiled is left out with a sentence."""
    found = {}
    if (compiler := shutil.which("cc")) is None:
        print("plain C is left out: there is no C compiler cc on the path")
    else:
        found["plain C"] = functions_of(compiled(folder, compiler, ("filter.c",)))
    headers = next((place for place in EIGEN if (place / "Eigen" / "Dense").is_file()), None)
    if (compiler := shutil.which("c++")) is None:
        print("C++ with Eigen is left out: there is no C++ compiler c++ on the path")
    elif headers is None:
        print("C++ with Eigen is left out, no headers of Eigen: apt install libeigen3-dev, or pip install cmeel-eigen")
    else:
        options = "-std=c++17", f"-I{headers}"
        found["C++ with Eigen"] = functions_of(compiled(folder, compiler, ("filter.cpp",), *options))
    return found


def compiled(folder, compiler, sources, *options):
    """Sources as a library in a folder, its path."""
    library = Path(folder, f"{Path(sources[0]).name}.so")
    files = [SOURCES / source for source in sources]
    subprocess.run([compiler, *FLAGS, *options, *files, "-lm", "-o", library], check=True)
    return library


def functions_of(path):
    """A library of this process."""
    library, pointer = ctypes.CDLL(path), ctypes.c_void_p
    library.one_epoch.argtypes = [pointer] * 4
    library.many_epochs.argtypes = [pointer, ctypes.c_long, *[pointer] * 3]
    library.one_epoch.restype = library.many_epochs.restype = None
    return library


def extension(folder):
    """The module of `compiled/extension.c`; None, with a sentence, where it cannot be compiled."""
    compiler = shutil.which("cc")
    if compiler is None or not (PYTHON / "Python.h").is_file():
        print("plain C as an extension of Python is left out: it needs a C compiler cc and Python's headers (Python.h)")
        return None
    headers = f"-I{PYTHON}", f"-I{np.get_include()}"
    path = str(compiled(folder, compiler, ("extension.c", "filter.c"), *headers))
    loader = importlib.machinery.ExtensionFileLoader("plain_c", path)
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("plain_c", loader))
    loader.exec_module(module)
    return module


class Build:
    """What could be compiled on this machine: libraries by language, and the extension or None."""

    def __init__(self):
        """Compile, up to half a minute; what is loaded stays when its files are gone."""
        with tempfile.TemporaryDirectory() as folder:
            self.libraries, self.extension = libraries(folder), extension(folder)


def memory(start):
    """The filter's memory as `compiled/filter.h` has it."""
    hand = start.hand
    numbers = [hand.f, hand.s, hand.a, hand.b, start.gate]
    matrices = hand.beacons, hand.dock, hand.cam_from_dock, start.phi, start.q, start.effect, start.x, start.covariance
    return np.concatenate([numbers, *(np.ravel(m) for m in matrices)])


class ByCtypes:
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


class ByExtension:
    """An epoch a call into the extension."""

    def __init__(self, module, start):
        """Start the filter."""
        self.step = functools.partial(module.step, memory(start))


def from_a_loop_in_c(library, start, spots, accelerations):
    """Ranges (n,), states (n, 6), covariances (n, 6, 6) of images (n, 3, 2), the loop and its answers in C."""
    filter_, answers = memory(start), np.empty((len(spots), ANSWER))
    images = filter_.ctypes.data, len(spots), spots.ctypes.data, accelerations.ctypes.data
    library.many_epochs(*images, answers.ctypes.data)
    return answers[:, 0], answers[:, 1:7], answers[:, 7:].reshape(-1, 6, 6)
