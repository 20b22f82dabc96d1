"""docs/extending.md, a motion: what the page says is done in a copy of the package, which then flies it."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")

FLIGHT = """
import sys
import numpy as np
import relnav

navigator = relnav.Navigator(relnav.load_model(sys.argv[1]))
for t in range(60):  # a chaser that closes at 5 cm/s before beacons 0.6 m apart, seen by a lens of 50 mm
    r = 10.0 - 0.05 * t
    navigator.step(float(t), [[-0.05 * 0.3 / r, 0.0], [0.05 * 0.3 / r, 0.0], [0.0, 0.0]])
before = navigator.step(60.0, np.full((3, 2), np.nan)).state
after = navigator.step(160.0, np.full((3, 2), np.nan)).state
print(relnav.__file__)
print(*np.abs(after[:3] - before[:3] - 100.0 * before[3:]), *np.abs(after[3:] - before[3:]))
"""


def functions():
    """The page's two functions as a module of kernels."""
    block = re.search(r"^>>> def free_transition_into.*?(?=^>>> dt)", PAGE, re.MULTILINE | re.DOTALL)[0]
    source = re.sub(r"^(>>> |\.\.\. ?)", "", block, flags=re.MULTILINE)
    return "from relnav.codegen.kernel import kernel\n\n\n" + re.sub(r"^def ", "@kernel\ndef ", source, flags=re.M)


def changed(root):
    """Make the page's changes below a folder: each old text stands in its file once."""
    (diff,) = re.findall(r"^```diff\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    count = 0
    for part in re.split(r"^--- .*\n(?=\+\+\+)", diff, flags=re.MULTILINE)[1:]:
        name, *hunks = re.split(r"^@@\n", part, flags=re.MULTILINE)
        path = root / re.fullmatch(r"\+\+\+ b/(\S+)\n", name)[1]
        text = path.read_text(encoding="utf-8")
        for hunk in hunks:
            lines = hunk.splitlines(keepends=True)
            old = "".join(line[1:] for line in lines if line[0] in " -")
            assert text.count(old) == 1, old
            text = text.replace(old, "".join(line[1:] for line in lines if line[0] in " +"))
            count += 1
        path.write_text(text, encoding="utf-8")
    return count


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    root = tmp_path_factory.mktemp("extended")
    for folder in ("relnav", "models"):
        shutil.copytree(ROOT / folder, root / folder, ignore=shutil.ignore_patterns("__pycache__", "compiled"))
    assert changed(root) == 5
    (root / "relnav" / "dynamics" / "free_drift.py").write_text(functions(), encoding="utf-8")
    return root


def fly(root, free):
    model = (root / "models" / "three_beacon_psd" / "model.toml").read_text(encoding="utf-8")
    (root / "drift.toml").write_text(model.replace("[orbit]\n", f"[orbit]\nfree_drift = {str(free).lower()}\n"))
    (root / "fly.py").write_text(FLIGHT, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "fly.py", "drift.toml"],
        cwd=root, env={"RELNAV_JIT": "0", "PYTHONPATH": str(root)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    where, numbers = done.stdout.splitlines()
    assert Path(where).is_relative_to(root)
    return [float(number) for number in numbers.split()]


def test_a_motion_that_the_page_describes_flies(copy):
    """A hundred seconds without an image: a free chaser goes straight on, one in orbit does not."""
    assert max(fly(copy, True)) < 1e-12
    assert max(fly(copy, False)) > 0.1
