"""Which numbers each run of a sensitivity study gets, so that causes can be told apart.

Two sets of base runs A and B, every number and every noise drawn anew; then for each cause A with that cause taken
from B (Saltelli et al. 2010, "Variance based sensitivity analysis of model output", Computer Physics Communications
181, 259). After them, one at a time: each number at plus and at minus one sigma, all others at zero, with the noise of
the first few runs of A.
"""

from collections.abc import Mapping

from relnav.simulation.streams import Draws, Stream

NOISE = "noise"
"""The cause that is everything drawn anew all the time: it comes with the number of the run."""
REPEATS = 4
"""Runs of A with whose noise each number is moved alone."""


class Design:
    """The runs of a study.

    drawn: what is drawn once a run, names by cause; base: runs of A, a power of two.
    """

    def __init__(self, drawn: Mapping[str, tuple[str, ...]], seed: int, base: int) -> None:
        self.base, self._seed, self._drawn = base, seed, dict(drawn)
        self.causes = (*drawn, NOISE)
        self.numbers = tuple(name for names in drawn.values() for name in names)
        self.repeats = min(base, REPEATS)

    @property
    def mixed(self) -> int:
        """Runs of A, B and their mixtures."""
        return self.base * (2 + len(self.causes))

    @property
    def runs(self) -> int:
        """All runs."""
        return self.mixed + 2 * self.repeats * len(self.numbers)

    def of(self, run: int) -> tuple[int, dict[str, float]]:
        """Number of the run whose noise this one gets, and the numbers drawn once for it, by name."""
        if run >= self.mixed:
            which, repeat = divmod(run - self.mixed, self.repeats)
            number, minus = divmod(which, 2)
            return 2 * repeat, {name: (1 - 2 * minus) * float(k == number) for k, name in enumerate(self.numbers)}
        block, pair = divmod(run, self.base)
        if block < 2:
            return 2 * pair + block, self._values(2 * pair + block)
        cause = self.causes[block - 2]
        if cause == NOISE:
            return 2 * pair + 1, self._values(2 * pair)
        other = self._values(2 * pair + 1)
        return 2 * pair, self._values(2 * pair) | {name: other[name] for name in self._drawn[cause]}

    def _values(self, run: int) -> dict[str, float]:
        if not self.numbers:
            return {}
        values = Draws(self._seed, run).normals(Stream.DESIGN, (len(self.numbers),))
        return dict(zip(self.numbers, values.tolist(), strict=True))
