"""Monitors: whether a step that was too long is a gap in the images or a jump of the clock.

Images of a slow approach need many seconds to tell, and a state that is off until then would be silently wrong. So the
clock is doubted from the step on (CLOCK), if a jump by all of it would move the position by more than its sigma bears,
until one of the two is much likelier. The logarithm of the odds: of innovations d with noise R, where the jump adds m
to each, the sum of (d m - m^2 / 2) / R, divided by 1 + u (sum of m^2 / R), as what the state did not know before the
step, u of the squared jump, position and velocity by the step, is in all images alike. The innovations are those of the
prediction from before the step: the filter takes a jump up within seconds, into its velocity too, and its own
innovations soon say nothing.

Cameras that image in bursts, or at random, have long steps all the time: the third longest of late is usual. Price: a
clock that jumps by less than two and a half of such steps is left to the innovations (`monitors.py`).
"""

from relnav.arrays import Matrix, Record, Vector
from relnav.codegen.kernel import kernel
from relnav.codegen.together import select
from relnav.estimation.monitors import TOO_LONG

LOST = 10.0
"""Usual times between images: two or three images in a row are often lost, so many seldom."""
LATELY_S = 1000.0
"""A step is as usual as the third longest of so long: cameras that image in bursts, or at random, have long ones. Once
or twice chance, or a clock, makes one. It fades: what has not come again for so long is not usual any more."""
MATTERS2, DECIDED, DOUBTED_S = 25.0, 8.0, 60.0
"""A jump that would move the position by five sigma is doubted, a minute at most, until it is e^8 times as likely as
none, or as unlikely."""


@kernel
def is_doubtful(watch: Record, dt: float) -> bool:
    """Whether a step of dt s is so long that the clock may have jumped."""
    usual = max(LOST * watch["interval"], TOO_LONG * watch["third"])
    return bool(watch["interval"] > 0.0 and dt > usual)


@kernel
def learn_step(watch: Record, dt: float) -> None:
    """Keep the longest steps; one that is usual by now is not doubted any more."""
    left = LATELY_S / (LATELY_S + dt)
    one, two, three = left * watch["longest"], left * watch["second"], left * watch["third"]
    watch["longest"], watch["second"] = max(one, dt), max(two, min(one, dt))
    watch["third"] = max(three, min(two, dt))
    watch["doubted"] = select(watch["doubted"] <= TOO_LONG * watch["third"], 0.0, watch["doubted"])


@kernel
def doubt_clock(watch: Record, dt: float, state: Vector, ld: Matrix) -> None:
    """Doubt a step that was much too long, if a jump of the clock by all of it would matter.

    State: position and velocity ahead of all else; ld: factors L D L^T of its covariance.
    """
    if not is_doubtful(watch, dt):
        return
    watch["doubted"], watch["shown"], watch["along"], watch["unsure"] = 0.0, 0.0, 0.0, 1.0 / MATTERS2
    for k in range(3):
        moved, variance, speed = state[3 + k] * dt, ld[k, k], ld[3 + k, 3 + k]
        for j in range(k):
            variance += ld[k, j] * ld[k, j] * ld[j, j]
        for j in range(3 + k):
            speed += ld[3 + k, j] * ld[3 + k, j] * ld[j, j]
        variance += speed * dt * dt
        if variance < watch["unsure"] * moved * moved:
            watch["doubted"], watch["unsure"] = dt, variance / (moved * moved)


@kernel
def weigh_jump(watch: Record, groups: Record) -> None:
    """Weigh the doubted step as a jump of the clock against none, by what the groups say of an image.

    To be called with what was seen, used or not: what a gate leaves agrees with the prediction.
    """
    if not watch["doubted"] > 0.0 or watch["hold"] > 0.0 or watch["pause"] > 0.0:
        return
    for g in range(groups.shape[0]):
        group = groups[g]
        for k in range(group["rows"] if group["seen"] > 0 else 0):
            moved, usual = group["motion"][k] * watch["doubted"], group["usual"][k] if group["learnt"] > 0 else 0.0
            watch["along"] += (group["value"][k] + group["taken"][k] - usual) * moved / group["noise"][k]
            watch["shown"] += moved * moved / group["noise"][k]
    odds = (watch["along"] - 0.5 * watch["shown"]) / (1.0 + watch["unsure"] * watch["shown"])
    if odds > DECIDED:
        watch["on"], watch["clock"], watch["restart"], watch["quiet"] = 1, 1, 1, 0.0
    if abs(odds) > DECIDED or watch["jumped"] > DOUBTED_S:
        watch["doubted"] = 0.0
