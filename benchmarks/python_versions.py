"""The package on every Python it is meant for: installed into a fresh environment, called, and a part of the tests.

Looks for python3.11 to python3.14 on the path, under pyenv, and through uv where that is there; says which are missing.

    python benchmarks/python_versions.py [--only 3.12] [--json FILE] [TESTS ...]
    python benchmarks/python_versions.py --prebuilt [--only 3.12]   # the wheel with compiled code, and its first call
    python benchmarks/python_versions.py --file dist/relnav-0.1.0-py3-none-any.whl   # what is to be published, alone
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
NEEDED = ("pytest>=9,<10", "pytest-timeout>=2.4", "hypothesis>=6.100", "mpmath>=1.3", "pyerfa>=2.0.1,<3")
QUICK = (
    "tests/geometry",
    "tests/cli/test_models_command.py",
    "tests/files/test_model_errors.py",
    "tests/files/test_units.py",
)
TRIED = """
import numpy as np
import relnav
model, push = relnav.load_model("three_beacon_psd"), np.array([1e-5, 0.0, -1e-5])
navigator, in_python = relnav.Navigator(model), relnav.Navigator(model)
for k in range(200):
    spots = np.array([[-1.5e-3, 1e-7 * k], [1.5e-3, 0.0], [0.0, 0.0]])
    record = navigator.step(0.1 * k, spots, acceleration_m_s2=push)
    same = relnav.Navigator.step(in_python, 0.1 * k, spots.tolist(), acceleration_m_s2=push.tolist())
    assert record.range_m == same.range_m or k == 0
assert record.has_state and np.array_equal(record.covariance, same.covariance), "a call is not its lines of Python"
state = record.state
del record, same, navigator, in_python
assert state[0] > 0.0 and not state.flags.writeable
"""
INSTALLED = (
    TRIED
    + """
import sys
assert not relnav.__file__.startswith(sys.argv[1]), "the checkout is called, not what was installed"
print(f"a call answered by {relnav.__file__.rpartition('/lib/')[2]}")
"""
)
"""To be run where the package's source is not, as is the next."""
FIRST_CALL = (
    INSTALLED
    + """
import time
assert "numba" not in sys.modules, "numba was needed: the wheel's code does not fit"
print(f"first estimate of beacons after {time.process_time():.2f} s of processor time, without numba")
"""
)


def interpreter(version: str) -> str | None:
    """A Python of this version that starts."""
    places = [shutil.which(f"python{version}"), *map(str, Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))]
    if (uv := shutil.which("uv")) is not None:
        found = subprocess.run([uv, "python", "find", version], capture_output=True, text=True, check=False)
        places.append(found.stdout.strip())
    asks = "import sys; print('%d.%d' % sys.version_info[:2])"
    for place in filter(None, places):
        said = subprocess.run([place, "-c", asks], capture_output=True, text=True, check=False)
        if said.stdout.strip() == version:
            return place
    return None


def steps_of(python: str, tests: list[str], file: Path | None, prebuilt: bool) -> dict[str, list[str]]:
    """What is done in an environment, by name."""
    installation = [python, "-m", "pip", "install", "-q"]
    if file is not None:
        log = str(ROOT / "examples" / "basilisk_approach" / "vbar_log.csv")
        return {
            "installation": [*installation, str(file.resolve())],
            "first call": [python, "-c", INSTALLED, str(ROOT)],
            "command": [python, "-m", "relnav", "filter", log, "--model", "three_beacon_psd", "--out", "track.csv"],
            "compiled call": [python, "-c", INSTALLED, str(ROOT)],
        }
    steps = {"installation": [*installation, str(ROOT), *NEEDED]}
    if prebuilt:
        return steps | {"first call": [python, "-c", FIRST_CALL, str(ROOT)]}
    return steps | {
        "first call": [python, "-c", TRIED],
        "compiled call": [python, "-c", TRIED],
        "tests": [python, "-m", "pytest", "-q", "-p", "no:xdist", "-o", "addopts=--import-mode=importlib", *tests],
    }


def tried(version: str, tests: list[str], *, file: Path | None = None, prebuilt: bool = False) -> dict[str, object]:
    """Install and test; what came of it."""
    place, begin = interpreter(version), time.monotonic()
    if place is None:
        return {"python": version, "outcome": "not on this machine"}
    with tempfile.TemporaryDirectory() as folder:
        python = str(Path(folder) / "bin" / "python")
        steps = {"environment": [place, "-m", "venv", folder]} | steps_of(python, tests, file, prebuilt)
        elsewhere = prebuilt or file is not None
        said = ""
        for name, command in steps.items():
            compiles = prebuilt or name == "compiled call"
            ways = {"RELNAV_PREBUILD": str(int(prebuilt)), "RELNAV_JIT": str(int(compiles)), "NUMBA_CACHE_DIR": folder}
            environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | ways
            done = subprocess.run(
                command, cwd=folder if elsewhere else ROOT, env=environment, capture_output=True, text=True, check=False
            )
            said = (done.stdout.strip() or done.stderr.strip()).splitlines()[-1:] or [""]
            if done.returncode != 0:
                last = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1:]
                return {"python": version, "outcome": f"{name} failed: {' '.join(last)}"}
        return {"python": version, "outcome": said[0], "seconds": round(time.monotonic() - begin)}


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("tests", nargs="*", default=list(QUICK))
    parser.add_argument("--only", action="append", choices=VERSIONS)
    parser.add_argument("--prebuilt", action="store_true", help="With compiled code in the wheel, and its first call.")
    parser.add_argument("--file", type=Path, help="An sdist or a wheel, installed instead of the checkout.")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = []
    for version in options.only or VERSIONS:
        found.append(tried(version, options.tests, file=options.file, prebuilt=options.prebuilt))
        print(json.dumps(found[-1]), flush=True)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    sys.exit(any("failed" in str(entry["outcome"]) for entry in found))


if __name__ == "__main__":
    main()
