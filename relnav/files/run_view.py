"""What there is to see of a run: its columns thinned, its claims, gates and events; for pictures and for the page.

A `RunView` is gathered part after part from solutions, or from the columns of a track file, whatever their number.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from relnav.accuracy.published import Claim
from relnav.arrays import Matrix, Vector
from relnav.estimation.consistency import Consistency, consistency_of_sum
from relnav.estimation.gating import chi_square_limit
from relnav.estimation.whiteness import NeighbourSums
from relnav.files.approach_view import Place, Places, misalignments
from relnav.files.innovation_columns import Innovations, SpotInnovations, unsaid
from relnav.files.port_columns import PortColumns
from relnav.files.spans import Event, Spans
from relnav.files.tables import COLUMNS, DOCKING_COLUMNS, STATE_COLUMNS, rows_of
from relnav.files.thinning import Thin, Thinning
from relnav.mission import Model, VisionMission
from relnav.navigation.lasting_words import in_every_image, marker_words
from relnav.navigation.record import Solution
from relnav.navigation.status import Alarm, EpochStatus
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT

FLAGS = tuple(f"is_{status.name.lower()}" for status in EpochStatus)
ALARMS = {f"alarm_{one.name.lower()}": one for one in Alarm if one.name}
"""Columns of 0 and 1, and what they tell."""
MOST_STEPS = 30
"""Of a bound that changes with the number of spots seen, before it is a thicket."""
PLACES = 12
BARS = 40
"""Averages of NIS over a run."""


@dataclass(frozen=True)
class Quantity:
    """A column to draw: its name, what a reader calls it, its unit, the column of its sigma, what claims call it."""

    column: str
    label: str
    unit: str
    claimed: str = ""

    @property
    def sigma(self) -> str:
        """The column of its sigma."""
        return f"sigma_{self.column}"

    @property
    def protection(self) -> str:
        """The column of its protection level."""
        return f"protection_{self.column}"


_NAMES = ("x, along V-bar", "y, along H-bar", "z, along R-bar", "x velocity", "y velocity", "z velocity")
STATES = tuple(
    Quantity(column, label, "m" if k < 3 else "m/s")
    for k, (column, label) in enumerate(zip(STATE_COLUMNS, _NAMES, strict=True))
)
DOCKING = tuple(
    Quantity(column, column.split("_")[0].capitalize(), "m" if k == 0 else "deg", column.split("_")[0])
    for k, column in enumerate(DOCKING_COLUMNS)
)
PORTS = tuple(Quantity(f"port_{a}_m", f"Port, {a}", "m", "range" if a == "x" else "") for a in "xyz")
"""x is out of the port, nearly the range."""
PORT_MOTION = (
    *(Quantity(f"port_v{axis}_m_s", f"Port velocity, {axis}", "m/s") for axis in "xyz"),
    *(Quantity(f"port_turn_{axis}_deg", f"Port attitude, {axis}", "deg") for axis in "xyz"),
    *(Quantity(f"port_rate_{axis}_deg_s", f"Port rate, {axis}", "deg/s") for axis in "xyz"),
)
RATES = tuple(Quantity(f"rate_{axis}_deg_s", f"Target rate, {axis}", "deg/s") for axis in "xyz")
TURNS = tuple(f"sigma_turn_{axis}_deg" for axis in "xyz")


WORDS = ("no state yet", "used whole", "used in part", "rejected", "no measurement", "started")
ROW_COLOURS = ("dots", "spread", "published", "gate", "soft", "estimate")
"""For each EpochStatus: what a reader is told, and in which colour."""


@dataclass(frozen=True)
class Row:
    """A row of the timeline: its column of 0 and 1, its label, and the name of its colour."""

    column: str
    label: str
    colour: str


@dataclass(frozen=True)
class NisBar:
    """NIS per degree of freedom over a stretch of epochs that were used whole, and its 95 % interval (NaN: none)."""

    begin_s: float
    end_s: float
    ratio: float
    lower: float
    upper: float


@dataclass
class RunView:
    """A run to look at.

    Attributes
    ----------
    title, metadata : str, dict
        What it is of, and what the log and the filter said.
    thin, names : Thin, dict
        The columns, and where each stands in them.
    claims : tuple of Claim
        Published figures of range, azimuth, elevation.
    counts : Counter
        Epochs by EpochStatus.
    alarmed : dict
        Epochs with each alarm that there was, by its column (`ALARMS`).
    ambiguous : int
        Epochs whose pose is ambiguous, of markers; -1 where nothing is known of that.
    rows : tuple of Row
        The timeline's.
    nis : Consistency
        Over all epochs used whole.
    events, events_left_out : list of Event, int
        What happened, and how much more of it there was.
    gate_probability : float
        Of the filter; NaN where it is not known.
    innovations : tuple of Quantity
        What an image was compared with, in columns of that name with gates in `gate_...`; empty if not known.
    unsaid : str
        Why innovations or gates are missing, a sentence; empty where they are not.
    of_vehicle : bool
        Whether it is a vehicle's.
    sensors : tuple of str
        Of a vehicle: with `used_...`, `nis_...` and `deviation_...` of each, as far as its track has them.
    places : list of Place
        Some epochs, spread over the run, with the covariance of the position; the last is where it ends.
    """

    title: str
    metadata: dict[str, str]
    thin: Thin
    names: dict[str, int]
    counts: Counter[int]
    alarmed: dict[str, int]
    ambiguous: int
    nis: Consistency
    gate_probability: float = math.nan
    claims: tuple[Claim, ...] = ()
    events: list[Event] = field(default_factory=list)
    events_left_out: int = 0
    innovations: tuple[Quantity, ...] = ()
    unsaid: str = ""
    rows: tuple[Row, ...] = ()
    sensors: tuple[str, ...] = ()
    of_vehicle: bool = False
    places: list[Place] = field(default_factory=list)

    def has(self, column: str) -> bool:
        """Whether the run has a column, with a number in it."""
        return column in self.names and bool(np.isfinite(self.thin.high[self.names[column]]).any())

    def line(self, column: str) -> Vector:
        """Values of a column over `thin.times()`."""
        return self.thin.line(self.names[column])

    @property
    def started(self) -> bool:
        """Whether any epoch has a state."""
        return bool(self.docking() or self.states())

    def largest(self, column: str) -> Vector:
        """The greatest value of each group, over `thin.times()`."""
        return self.thin.largest(self.names[column])

    def docking(self) -> tuple[Quantity, ...]:
        """What the approach is told in: range and angles, or the ports."""
        return tuple(q for q in (*DOCKING, *PORTS) if self.has(q.column))

    def states(self) -> tuple[Quantity, ...]:
        """The state's components, and a target's rates."""
        return tuple(q for q in (*STATES, *RATES) if self.has(q.column))

    def ports(self) -> tuple[Quantity, ...]:
        """How the port moves and turns, seen from the target's."""
        return tuple(q for q in PORT_MOTION if self.has(q.column))

    def claim(self, quantity: Quantity) -> Claim | None:
        """The figure published for a quantity's 1-sigma."""
        return next((c for c in self.claims if quantity.claimed and c.quantity == quantity.claimed), None)

    def place(self) -> tuple[Matrix, Matrix]:
        """Position in docking axes (3, m) over `thin.times()`, x out of the port, and its sigmas along these axes.

        For range and angles the sigmas are along the line of sight and across it, which lies near x. Which of the two a
        track has is told by its columns, as a run without a state has no value in any; NaN where a track has neither.
        """
        quantities = DOCKING if DOCKING[0].column in self.names else PORTS
        first, second, third = (self._or_nan(q.column, self.line) for q in quantities)
        s = [self._or_nan(q.sigma, self.largest) for q in quantities]
        if quantities is PORTS:
            return np.stack([first, second, third]), np.stack(s)
        r, azimuth, elevation = first, second * math.pi / 180.0, third * math.pi / 180.0
        level = r * np.cos(elevation)
        place = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), -r * np.sin(elevation)])
        across = r * math.pi / 180.0
        return place, np.stack([s[0], level * math.pi / 180.0 * s[1], across * s[2]])

    def _or_nan(self, column: str, values: Callable[[str], Vector]) -> Vector:
        return values(column) if column in self.names else np.full(len(self.thin.times()), math.nan)

    def nis_limit(self, probability: float) -> Vector:
        """What NIS stays below with a probability, over `thin.times()`, by the degrees of freedom there."""
        dof = self.largest("dof")
        limits = {d: chi_square_limit(probability, int(d)) for d in np.unique(dof[dof > 0]).tolist()}
        return np.array([limits.get(d, math.nan) for d in dof.tolist()])

    def nis_bound(self, probability: float) -> tuple[Vector, bool]:
        """The same to draw; where it would be a thicket, that of the usual number of spots alone, and True."""
        line = self.nis_limit(probability)
        known = np.isfinite(line)
        if int((np.diff(line[known]) != 0.0).sum()) <= MOST_STEPS:
            return line, False
        often, count = np.unique(line[known], return_counts=True)
        return np.full(len(line), often[count.argmax()]), True

    def nis_bars(self) -> list[NisBar]:
        """Averages over stretches of the run."""
        nis, dof, _ = self.thin.sums
        out = []
        for part in np.array_split(np.arange(len(nis)), min(BARS, len(nis))):
            lasting = bool(self.nis.withheld)
            mean = consistency_of_sum("NIS", float(nis[part].sum()), int(dof[part].sum()), lasting=lasting)
            if mean.dof:
                ends = float(self.thin.begin[part[0]]), float(self.thin.end[part[-1]])
                out.append(NisBar(*ends, mean.ratio, mean.lower, mean.upper))
        return out


def watcher_of(mission: Any, most: int) -> "RunWatcher":
    """A watcher of a mission's runs, with the figures published for it."""
    from relnav.files.models import load_published

    return RunWatcher(most, mission, () if mission is None else load_published(mission).claims)


class RunWatcher:
    """Gathers a `RunView`, part after part."""

    def __init__(self, most: int, model: Any = None, claims: tuple[Claim, ...] = ()) -> None:
        """Keep about so many groups; the model, if it is known, tells gates, its published figures are drawn."""
        self._thinning, self._model = Thinning(most), model
        self._claims, self._places = claims, Places(PLACES, model)
        self._names: list[str] = []
        self._decisions = Spans((EpochStatus.UPDATED, EpochStatus.PREDICTED), lambda code: EpochStatus(code).name)
        self._alarms = Spans((0,), lambda code: f"ALARM {Alarm(code).words}")
        self._counts: Counter[int] = Counter()
        self._alarmed: Counter[str] = Counter()
        self._total, self._dof, self._title, self._ambiguous = 0.0, 0, "", -1
        self._neighbours = NeighbourSums()
        self._innovations: Innovations | SpotInnovations | None = None
        self._port, self._unsaid = PortColumns(), ""
        self._metadata: dict[str, str] = {}

    def take(self, part: Any) -> None:
        """Go on with the next epochs of a `Solution` or a `PoseSolution`."""
        if isinstance(part, Solution):
            columns: dict[str, Any] = dict(zip(COLUMNS, rows_of(part), strict=True)) | {"status": part.status}
            if self._innovations is None:
                self._innovations = Innovations(part, self._model if isinstance(self._model, Model) else None)
            assert isinstance(self._innovations, Innovations)
            columns |= self._innovations.columns(part)
            self._title = f"{part.model}, method {part.method}" + (", smoothed" if part.smoothed else "")
        else:
            from relnav.files.marker_logs import track_columns

            columns = dict(track_columns(part))
            if self._innovations is None:
                self._innovations = SpotInnovations(part.mission)
            assert isinstance(self._innovations, SpotInnovations)
            columns |= self._innovations.columns(part)
            self._title = part.model + (", smoothed" if part.smoothed else "")
        self._metadata = {key: str(value) for key, value in part.metadata.items()}
        self._unsaid = unsaid(part)
        self.take_columns(columns)

    def take_columns(self, columns: Mapping[str, Any]) -> None:
        """Go on with the next epochs as columns of a track, `t_s` and `nis`, `dof`, `status` among them."""
        columns = {**columns, **misalignments(columns, self._model)}
        self._places.take(columns)
        status = np.asarray(columns["status"])
        flags = {name: (status == code).astype(np.float64) for code, name in enumerate(FLAGS)}
        alarm = np.nan_to_num(columns.get("alarm", np.zeros(len(status)))).astype(np.int64)
        flags |= {name: (alarm & int(one) > 0).astype(np.float64) for name, one in ALARMS.items()}
        self._alarmed.update({name: int(flags[name].sum()) for name in ALARMS})
        if "ambiguity" in columns:
            unsure = (np.asarray(columns["ambiguity"]) < AMBIGUITY_LIMIT) & (status != EpochStatus.WAITING)
            flags["ambiguous"] = unsure.astype(np.float64)
            self._ambiguous = max(0, self._ambiguous) + int(unsure.sum())
        t, nis, dof = np.asarray(columns["t_s"]), np.asarray(columns["nis"]), np.asarray(columns["dof"])
        whole = np.isin(status, (EpochStatus.UPDATED, EpochStatus.STARTED)) & (dof > 0) & np.isfinite(nis)
        sums = np.stack([np.where(whole, nis, 0.0), np.where(whole, dof, 0), np.ones(len(t))])
        self._total, self._dof = self._total + float(sums[0].sum()), self._dof + int(sums[1].sum())
        innovations = [np.asarray(one) for name, one in columns.items() if name.startswith("innovation_")]
        if innovations:
            self._neighbours.take(np.stack(innovations, axis=1), whole)
        self._keep(t, {**columns, **self._port.of(columns), **flags}, sums)
        codes, numbers = np.unique(status, return_counts=True)
        self._counts.update(dict(zip(codes.tolist(), numbers.tolist(), strict=True)))
        self._decisions.take(t, status)
        self._alarms.take(t, alarm)

    def _keep(self, t: Vector, columns: Mapping[str, Any], sums: Matrix) -> None:
        """Thin the columns of the next epochs, without time and covariance."""
        kept = {name: one for name, one in columns.items() if not name.startswith("cov_") and name != "t_s"}
        if not self._names:
            self._names = list(kept)
        self._thinning.take(t, np.stack([np.asarray(kept[name], dtype=np.float64) for name in self._names]), sums)

    def view(self, log: str = "", title: str = "", metadata: dict[str, str] | None = None) -> RunView:
        """What was gathered; log, title and metadata in place of the solution's own, if given."""
        said = dict(self._metadata if metadata is None else metadata)
        if isinstance(self._model, VisionMission):
            said = marker_words(self._model) | said
        if log:
            said["log"] = log
        settings = getattr(self._model, "filter", None)
        events, left_out = self._events()
        view = RunView(
            title=title or self._title,
            metadata=said,
            thin=self._thinning.thin(),
            names={name: k for k, name in enumerate(self._names)},
            counts=self._counts,
            alarmed={name: self._alarmed[name] for name in ALARMS if self._alarmed[name]},
            ambiguous=self._ambiguous,
            nis=consistency_of_sum(
                "NIS",
                self._total,
                self._dof,
                lasting=bool(said.get("considered")),
                neighbours=None if in_every_image(said.get("considered", "")) else self._neighbours,
            ),
            gate_probability=math.nan if settings is None else settings.gate_probability,
            claims=self._claims,
            events=sorted(events, key=lambda event: event.begin_s),
            events_left_out=left_out,
            innovations=self._compared(),
            rows=self._rows(),
            places=self._places.places(),
        )
        if not view.started:
            view.unsaid = "No innovations: the filter never started."
        elif self._unsaid and not any(view.has(f"gate_{quantity.column}") for quantity in view.innovations):
            view.unsaid = f"No {'gates' if view.innovations else 'innovations'}: {self._unsaid}."
        return view

    def _events(self) -> tuple[list[Event], int]:
        """What happened, and how much more of it there was."""
        return self._decisions.events + self._alarms.events, self._decisions.left_out + self._alarms.left_out

    def _rows(self) -> tuple[Row, ...]:
        decided = [
            Row(FLAGS[code], f"{WORDS[code]} ({self._counts[code]})", ROW_COLOURS[code])
            for code in range(len(FLAGS))
            if self._counts[code]
        ]
        alarmed = [(name, self._alarmed[name]) for name in ALARMS if self._alarmed[name]]
        unsure = [Row("ambiguous", f"ambiguous pose ({self._ambiguous})", "gate")] if self._ambiguous > 0 else []
        alarms = (Row(name, f"ALARM {ALARMS[name].name} ({count})", "gate") for name, count in alarmed)
        return (*decided, *unsure, *alarms)

    def _compared(self) -> tuple[Quantity, ...]:
        names = () if self._innovations is None else self._innovations.names()
        return tuple(Quantity(name, *_words(name)) for name in names)


def _words(column: str) -> tuple[str, str]:
    """What a reader calls an innovation, and its unit."""
    name: list[str]
    _, *name, unit = column.split("_")
    label = name[0].capitalize() if len(name) == 1 else f"Spot {name[0].upper()}, {name[1]}"
    return label, {"um": "µm"}.get(unit, unit)
