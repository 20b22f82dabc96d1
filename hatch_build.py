"""Compiles the filters while a wheel is built, so that a fresh install gives its first estimate at once.

What is compiled is the package's own code, run here as a user runs it (`FLIGHTS`), as many at once as there are
processors and the longest first, so that they end together. The files that it leaves are put into the wheel
(`relnav/codegen/store.py`), which then is one for this platform and this Python. On another processor of that platform
they do not fit and are left alone. RELNAV_PREBUILD=0 in the environment builds a wheel without them, for any platform:
`py3-none-any`.

It also makes the description that an index shows: the README, whose links into the checkout lead to the repository that
`[project.urls]` names as `Source`, or are left out as long as none is named.
"""

import gc
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
    from hatchling.metadata.plugin.interface import MetadataHookInterface
except ImportError:  # run as one of the flights
    BuildHookInterface = MetadataHookInterface = object

ROOT = Path(__file__).resolve().parent
PLACE = "relnav/compiled"


def for_an_index(text, source):
    """Text of the README without a link into the checkout: they lead into `source`, or fall away where it is empty."""

    def link(found):
        picture, words, path = found.groups()
        if not source:
            return "" if picture else words
        return f"{picture}[{words}]({source.rstrip('/')}/{'raw' if picture else 'blob'}/HEAD/{path})"

    return re.sub(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)", link, text)


class Description(MetadataHookInterface):
    """The package's description as an index shows it."""

    PLUGIN_NAME = "custom"

    def update(self, metadata):
        """Fill in what pyproject.toml declares as dynamic."""
        text = for_an_index((ROOT / "README.md").read_text("utf-8"), metadata.get("urls", {}).get("Source", ""))
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


class Prebuild(BuildHookInterface):
    """Adds the compiled code to a wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version, build_data):
        """Compile before the wheel is packed; an editable install compiles when it is first used."""
        if self.target_name != "wheel" or version == "editable" or os.environ.get("RELNAV_PREBUILD") == "0":
            return
        self._folder = tempfile.TemporaryDirectory()
        here = os.pathsep.join([str(ROOT), *filter(None, sys.path)])  # a build's own packages stand in its path
        environment = os.environ | {"NUMBA_CACHE_DIR": self._folder.name, "PYTHONPATH": here, "RELNAV_JIT": "1"}

        def fly(name):
            return subprocess.run([sys.executable, __file__, name], env=environment, cwd=ROOT, check=False).returncode

        with ThreadPoolExecutor(os.cpu_count()) as at_once:
            codes = list(at_once.map(fly, FLIGHTS))
        for name, code in zip(FLIGHTS, codes, strict=True):
            if code != 0:
                self._folder.cleanup()
                raise RuntimeError(
                    f"compiling for {name} failed (see above); RELNAV_PREBUILD=0 builds without compiled code"
                )
        for path in sorted(Path(self._folder.name).glob("relnav_*/*.code")):
            build_data["force_include"][str(path)] = f"{PLACE}/{path.name}"
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, version, build_data, artifact_path):  # noqa: ARG002  (as hatchling calls it)
        """Nothing is left in the tree."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()


def beacons():
    """An image at a time, everything read, a log forward and backward, and text tables written and read back."""
    import numpy as np

    import relnav
    from relnav.files.compiled_text import prepare

    image = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
    model, t = relnav.load_model("three_beacon_psd"), 0.1 * np.arange(5)
    navigator = relnav.Navigator(model)
    for k in t.tolist():
        record = navigator.step(k, image, acceleration_m_s2=[1e-6, 0.0, 0.0], dcm_cam_from_lvlh=model.dcm_cam_from_lvlh)
    repr(record), record.covariance
    repr(relnav.filter_epochs(model, t, np.tile(image, (len(t), 1, 1)), smooth=True).range_m)
    prepare()  # here and not by itself: numba's own start is half of what it takes


def markers():
    """The same with markers, and the track that is written of it."""
    import numpy as np

    import relnav
    from relnav.geometry.rotation import quaternions_from_dcm_into
    from relnav.navigation.pose_innovations import MarkerInnovations
    from relnav.navigation.pose_log import filter_marker_epochs

    image, model = [[459.0, 532.0], [562.0, 531.0], [511.0, 478.0]], relnav.load_model("three_marker_vision")
    navigator = relnav.PoseNavigator(model)
    for k in range(3):
        record = navigator.step(0.1 * k, image)
    repr(record), record.covariance, record.docking
    t, images = 0.1 * np.arange(5), np.tile(image, (5, 1, 1))
    MarkerInnovations(model).of(filter_marker_epochs(model, t, images))  # as a picture has them
    solution = filter_marker_epochs(model, t, images, smooth=True)
    quaternions_from_dcm_into(solution.docking.dcm_target_from_chaser, np.empty((5, 4)))  # as a track has them


FLIGHTS = {"markers": markers, "beacons": beacons}
"""The longest first."""

if __name__ == "__main__":
    gc.disable()  # a search through all that the compiler has made takes 4 % of its time and finds nothing to give back
    FLIGHTS[sys.argv[1]]()
    sys.stdout.flush()
    os._exit(0)  # to give back, piece by piece, what the compiler has made takes 8 % of a flight
