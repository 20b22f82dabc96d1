"""Monitors: whether spots are refused more often than glints and reflections explain.

A gate leaves what agrees with the prediction, so that an error that comes and goes with the images (an attitude that is
stated in steps while the craft turns, two clocks in one log) shows in what is refused alone: monitors of innovations
see good ones, and runs of refusals end before they are long. So the share of spots that are refused is averaged over
some seconds, and compared with that of spots which are bad one by one: as a binomial number, by five of its sigmas.

A spot that is refused in every image for seconds is left out. It is bad, the others tell, and what becomes of it is
watched already (`returning.py`).
"""

from relnav.arrays import Record
from relnav.codegen.kernel import kernel
from relnav.codegen.together import select
from relnav.estimation.monitors import SAID_S

BAD_SPOTS = 0.15
"""Share of spots that may be bad: with one in ten, as simulators draw them and lamps of other craft or the sun's make
them, the limit is six sigma away or more."""
BAD_IMAGES = 1.0 - (1.0 - BAD_SPOTS) ** 3
"""The same of images that are used, or refused, as a whole: each of three spots is good."""
LATELY_S, FEWEST = 20.0, 40.0
"""The mean's time constant, and how many images it has at least: of fewer a share as high as the limit says little."""
LEAST, LIMIT2 = 10, 25.0
"""Images before it is judged; squared sigmas of the share: with 2.9e-7 each second or so, and a share of bad spots that
is the highest allowed all the time, one alarm in a month."""


@kernel
def forget_refusals(watch: Record) -> None:
    """A track has started that replaces none."""
    watch["judged"], watch["over"], watch["over_noise"], watch["refusing"] = 0, 0.0, 0.0, 0.0


@kernel
def count_refusals(watch: Record, since: float, share: float, spots: float, bad: float, seen: bool) -> None:
    """Take the share of an image's spots that were refused into the mean, where any was seen.

    since: s since the last image; spots: how many numbers that is, each refused with the probability `bad`. Where it
    is longer than usual, images between showed nothing, and nothing bad: a dark lamp must not leave glints alone.
    """
    judged, usual = watch["judged"] + 1, watch["interval"]
    weight = max(1.0 / judged, min(since / (since + LATELY_S), 1.0 / FEWEST))
    shown = share * select(since > usual, select(usual > 0.0, usual, since) / select(since > 0.0, since, 1.0), 1.0)
    over = watch["over"] + weight * (shown - bad - watch["over"])
    noise = (1.0 - weight) * (1.0 - weight) * watch["over_noise"] + weight * weight * bad * (1.0 - bad) / spots
    watch["judged"] = select(seen, judged, watch["judged"])
    watch["over"] = select(seen, over, watch["over"])
    watch["over_noise"] = select(seen, noise, watch["over_noise"])
    many = seen & (judged >= LEAST) & (over > 0.0) & (over * over > LIMIT2 * noise)
    watch["refusing"] = select(many, SAID_S, watch["refusing"])
