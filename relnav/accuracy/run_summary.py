"""The figures of one filtered log, gathered part after part, so that a log of any length can be summed up."""

import math
from collections import Counter
from typing import Any

import numpy as np

from relnav.accuracy.published import Comparison, Published, PublishedTrend
from relnav.estimation.consistency import Consistency, consistency_of_sum
from relnav.estimation.whiteness import NeighbourSums
from relnav.navigation.lasting_words import in_every_image, left_out_line
from relnav.navigation.record import Solution
from relnav.navigation.status import Alarm, EpochStatus
from relnav.sensors.measurement import Status

GAP = 10.0
"""Times the interval before: so much longer is a gap in the log."""


METHOD_WORDS = {
    "fix": "fix needs three spots and no attitude; --method spots: one is enough, angles as good as the attitude",
    "spots": "spots needs the camera's attitude, whose error is in the angles; --method fix: three spots, none",
}
"""What each measurement model needs, and what the other would bring."""


class RunSummary:
    """What became of the epochs, NIS over those used whole, and the reported sigma beside the published figures.

    Attributes
    ----------
    model, method, smoothed, gate_probability
        What was run.
    epochs, t_first_s, t_last_s : int, float, float
        How many, from when to when.
    counts, reasons : Counter
        Epochs by EpochStatus; and by Status of their measurement.
    alarms : Counter
        Epochs by Alarm.
    alarmed, alarm_first_s, alarm_last_s : int, float, float
        Epochs with any, the first and the last of them.
    started_s, known_s : float
        First time with a state, last time with one; NaN if there is none.
    restarts : int
        How often a confirmed start replaced a track.
    last : EpochStatus
        Of the last epoch.
    ignored : str
        Columns of the log that nobody used.
    considered : str
        Lasting errors that the covariance includes.
    hint : str
        The likely reason, should the filter not start or reject much.
    longest_gap_s : float
        Longest time between rows.
    refused_after_gaps : int
        Epochs with something rejected between a gap (`GAP`) and the first image after it that was used whole.
    replaced : int
        Confirmed starts that replaced a track which no gap had gone before, and which had not been lost.
    notes : tuple of str
        What else there is to say of the log, for a reader.
    """

    def __init__(self, published: Published, gate_probability: float) -> None:
        self.gate_probability = gate_probability
        self.model, self.method, self.smoothed, self.restarts = "", "", False, 0
        self.epochs, self.t_first_s, self.t_last_s = 0, math.nan, math.nan
        self.started_s, self.known_s = math.nan, math.nan
        self.counts: Counter[int] = Counter()
        self.reasons: Counter[int] = Counter()
        self.alarms: Counter[int] = Counter()
        self.alarmed, self.alarm_first_s, self.alarm_last_s = 0, math.nan, math.nan
        self.last = EpochStatus.WAITING
        self.ignored, self.considered, self.left_out = "", "", ""
        self.notes: tuple[str, ...] = ()
        self._trend = PublishedTrend(published)
        self.longest_gap_s, self.hint, self._t_before, self._interval = 0.0, "", math.nan, math.nan
        self.refused_after_gaps, self.replaced, self._after_gap = 0, 0, False
        self._sigma: tuple[float, ...] = (math.nan,) * 3
        self._neighbours = NeighbourSums()
        self._used, self._used_dof, self._seen, self._seen_dof, self._seen_epochs = 0.0, 0, 0.0, 0, 0

    def take(self, part: Solution) -> None:
        """Go on with the next epochs; at least one."""
        self.model, self.method, self.smoothed, self.restarts = part.model, part.method, part.smoothed, part.restarts
        self.considered, self.left_out = part.metadata.get("considered", ""), part.metadata.get("left out", "")
        if self.epochs == 0:
            self.t_first_s = float(part.t_s[0])
        self.epochs += len(part)
        self.t_last_s = float(part.t_s[-1])
        self._take_gaps(part)
        self.last = EpochStatus(int(part.status[-1]))
        for counter, codes in ((self.counts, part.status), (self.reasons, part.measurement_status)):
            values, numbers = np.unique(codes, return_counts=True)
            counter.update(dict(zip(values.tolist(), numbers.tolist(), strict=True)))
        self._take_alarms(part)
        started = part.t_s[part.status == EpochStatus.STARTED]
        if len(started) and math.isnan(self.started_s):
            self.started_s = float(started[0])
        known = part.t_s[part.status != EpochStatus.WAITING]
        if len(known):
            self.known_s = float(known[-1])
        used = part.accepted & np.isfinite(part.nis) & (part.dof > 0)
        self._used += float(part.nis[used].sum())
        self._used_dof += int(part.dof[used].sum())
        self._neighbours.take(part.innovation, used)
        seen = part.dof > 0
        self._seen += float(part.nis[seen].sum())
        self._seen_dof += int(part.dof[seen].sum())
        self._seen_epochs += int(seen.sum())
        self._trend.take(part)
        if len(known):
            self._sigma = tuple(part.docking_sigma[part.status != EpochStatus.WAITING][-1].tolist())

    def _take_gaps(self, part: Solution) -> None:
        """Tell what follows a gap, whose control nobody may have logged, from what the images alone say."""
        intervals = np.diff(part.t_s, prepend=self._t_before)
        before = np.concatenate([[self._interval], intervals[:-1]])
        status = part.status
        used = (status == EpochStatus.UPDATED) | (status == EpochStatus.STARTED)
        number = np.arange(1, len(part) + 1)
        gap = np.maximum.accumulate(np.where(intervals > GAP * before, number, 0))
        ended = np.maximum.accumulate(np.concatenate([[0], np.where(used, number, 0)[:-1]]))
        after = np.where((gap == 0) & (ended == 0), self._after_gap, gap > ended)
        refused = (status == EpochStatus.PARTIAL) | (status == EpochStatus.REJECTED)
        earlier = np.concatenate([[self.last], status[:-1]])
        replaced = (status == EpochStatus.STARTED) & (earlier != EpochStatus.WAITING)
        self.refused_after_gaps += int(np.sum(refused & after))
        self.replaced += int(np.sum(replaced & ~after))
        self._after_gap = bool(after[-1] and not used[-1])
        self.longest_gap_s = max(self.longest_gap_s, float(np.nanmax(intervals, initial=0.0)))
        self._t_before, self._interval = float(part.t_s[-1]), float(intervals[-1])

    def _take_alarms(self, part: Solution) -> None:
        alarmed = part.t_s[part.alarm != 0]
        if not len(alarmed):
            return
        self.alarms.update({int(one): int(np.sum(part.alarm & int(one) > 0)) for one in Alarm})
        if self.alarmed == 0:
            self.alarm_first_s = float(alarmed[0])
        self.alarmed, self.alarm_last_s = self.alarmed + len(alarmed), float(alarmed[-1])

    @property
    def alarm_line(self) -> str:
        """What the monitors say of the log; empty if nothing."""
        if not self.alarmed:
            return ""
        if self.alarms[Alarm.UNWATCHED]:
            return "not monitored for persistent faults: this engine has no monitors"
        names = ", ".join(f"{one.name} {self.alarms[one]}" for one in Alarm if self.alarms[one])
        return (
            f"ALARM in {self.alarmed} epochs, {self.alarm_first_s:.12g} s to {self.alarm_last_s:.12g} s "
            f"(epochs: {names}): do not use the states there"
        )

    @property
    def started(self) -> bool:
        """Whether any epoch has a state."""
        return not math.isnan(self.started_s)

    @property
    def accepted(self) -> int:
        """Epochs of which everything that was seen was used."""
        return self.counts[EpochStatus.UPDATED] + self.counts[EpochStatus.STARTED]

    @property
    def refused(self) -> int:
        """Epochs with something rejected."""
        return self.counts[EpochStatus.PARTIAL] + self.counts[EpochStatus.REJECTED]

    @property
    def refused_unexplained(self) -> bool:
        """Whether more was rejected than the gate alone explains, and than gaps in the log do."""
        chance = 3.0 * (1.0 - self.gate_probability) * self._seen_epochs
        refused = self.refused - self.refused_after_gaps
        return bool(self.replaced or refused > chance + 5.0 * chance**0.5 + 3.0)

    @property
    def _gap_line(self) -> str:
        """What gaps in the log, or a track lost without images, led to."""
        anew, count = self.restarts - self.replaced, self.refused_after_gaps
        said = [f"the track was started anew {anew} times; "] if anew else []
        said.append(f"longest gap {self.longest_gap_s:.6g} s")
        if count:
            said.append(
                f"; {count} images after gaps contradict what was predicted across them: thrust not in the log?"
            )
        return "  " + "".join(said)

    @property
    def nis(self) -> Consistency:
        """NIS of the epochs that were used whole."""
        neighbours = None if in_every_image(self.considered) else self._neighbours
        lasting = bool(self.considered)
        return consistency_of_sum("NIS", self._used, self._used_dof, lasting=lasting, neighbours=neighbours)

    @property
    def nis_all_per_dof(self) -> float:
        """NIS of everything that was seen, per degree of freedom."""
        return self._seen / max(1, self._seen_dof)

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """Reported sigma at the end beside each published figure."""
        return self._trend.comparisons()

    def to_dict(self) -> dict[str, Any]:
        """The figures as plain values."""
        return {
            "model": self.model,
            "method": self.method,
            "smoothed": self.smoothed,
            "considered": self.considered,
            "left_out": self.left_out,
            "epochs": self.epochs,
            "t_first_s": self.t_first_s,
            "t_last_s": self.t_last_s,
            "started_s": self.started_s if self.started else None,
            "restarts": self.restarts,
            "epochs_by_status": {status.name.lower(): self.counts[status] for status in EpochStatus},
            "accepted": self.accepted,
            "alarmed": self.alarmed,
            "alarm_first_s": self.alarm_first_s if self.alarmed else None,
            "alarm_last_s": self.alarm_last_s if self.alarmed else None,
            "epochs_by_alarm": {str(one.name).lower(): self.alarms[one] for one in Alarm},
            "nis_per_dof": self.nis.ratio,
            "nis_interval": [self.nis.lower, self.nis.upper],
            "nis_consistent": None if self.nis.withheld else self.nis.consistent,
            "nis_overconfident": None if self.nis.withheld else self.nis.overconfident,
            "innovation_correlation": None if math.isnan(self.nis.correlation) else round(self.nis.correlation, 6),
            "innovations_correlated": self.nis.correlated,
            "nis_all_per_dof": self.nis_all_per_dof,
            "refused_unexplained": self.refused_unexplained,
            "rows": [
                {
                    "quantity": row.claim.quantity,
                    "published": row.claim.value,
                    "unit": row.claim.unit,
                    "statistic": row.claim.statistic,
                    "sigma_at_end": row.sigma,
                    "ratio": row.ratio,
                    "met_from_s": row.met_from_s,
                }
                for row in self.comparisons
            ],
        }

    def lines(self, log: str) -> list[str]:
        """The figures for a reader."""
        method = self.method + (", smoothed" if self.smoothed else "")
        span = f"{self.epochs} epochs, {self.t_first_s:.12g} s to {self.t_last_s:.12g} s"
        lines = [f"{log}: {span}; model {self.model}, method {method}"]
        lines.append(METHOD_WORDS[self.method])
        if self.ignored:
            lines.append(f"ignored columns: {self.ignored}")
        if self.considered:
            lines.append(f"lasting errors in the covariance: {self.considered}")
        if self.left_out:
            lines.append(left_out_line(self.left_out))
        lines.extend(self.notes)
        if not self.started:
            names = [f"{Status(code).name} {count}" for code, count in sorted(self.reasons.items())]
            lines.append(
                f"NOT STARTED: no epoch was confirmed by the next; measurements by outcome: {', '.join(names)}"
            )
            if self.reasons[Status.SWAPPED]:
                lines.append("  SWAPPED: the image is upside down for the stated attitude; A and B exchanged?")
            if self.hint:
                lines.append(f"  {self.hint}")
            return lines
        counts = self.counts
        lines.append(
            f"started at {self.started_s:.12g} s, restarts {self.restarts}; epochs used whole {self.accepted}, "
            f"in part {counts[EpochStatus.PARTIAL]}, rejected {counts[EpochStatus.REJECTED]}, "
            f"without a measurement {counts[EpochStatus.PREDICTED]}, without a state {counts[EpochStatus.WAITING]}"
        )
        if self.alarm_line:
            lines.append(self.alarm_line)
        lines.append(f"{self.nis} (epochs used whole)")
        if self.restarts > self.replaced or self.refused_after_gaps:
            lines.append(self._gap_line)
        if self.refused_unexplained:
            lines.append(
                f"  BUT {self.refused - self.refused_after_gaps} epochs had spots rejected, more than the gate alone "
                f"explains, and restarts are {self.restarts}; NIS of all that was seen: {self.nis_all_per_dof:.3g} per "
                "degree of freedom"
            )
            if self.hint:
                lines.append(f"  {self.hint}")
        if self.last == EpochStatus.WAITING:
            lines.append("  THE TRACK IS LOST at the end of the log: its uncertainty outgrew the range")
        if not self.comparisons:
            quantities = ("range", "azimuth", "elevation")
            values = (self._sigma[0], *(math.degrees(sigma) for sigma in self._sigma[1:]))
            sigmas = (f"{n} {v:.5f} {u}" for n, v, u in zip(quantities, values, ("m", "deg", "deg"), strict=True))
            lines.append(f"1-sigma at {self.known_s:.12g} s: {', '.join(sigmas)}")
        if self.comparisons:
            lines.append(f"1-sigma at {self.known_s:.12g} s   reported    published   ratio   within it after")
            for row in self.comparisons:
                after_s = round(row.met_from_s - self.t_first_s, 3)
                since = "never" if math.isnan(after_s) else f"{after_s:.12g} s"
                value = f"{row.sigma:.5f} {row.claim.unit}"
                claim = f"{row.claim.value:g} {row.claim.unit}"
                lines.append(f"  {row.claim.quantity:<16}{value:>12}{claim:>13}{row.ratio:>8.3f}   {since}")
        return lines
