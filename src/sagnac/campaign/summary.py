"""What the runs of a campaign came to: error against bound, coverage and NEES at each point, and what is out of its band.

With n runs and errors that are normal with standard deviation s, ``n RMSE^2 / s^2`` is chi-square with n degrees of freedom: that
gives the interval of RMSE over the bound. A coverage is a share of n runs, with the interval of Clopper and Pearson; the sum
of the NEES of all runs is chi-square with the sum of their degrees of freedom. Where standard uncertainties follow from the
scatter of few segments, intervals are Student's, and NEES is not judged: it is chi-square for a known covariance alone.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field

from .. import results
from .._version import __version__
from ..frames import Array
from ..results import Record, Software
from .sizes import shown_unit
from .tally import LEVELS, PointTally, Tally, widest
from .tasks.about import PointAbout

SCHEMA = "sagnac/campaign-summary/1"
SCHEMA_FILE = Path(__file__).with_name("campaign-summary-1.schema.json")
CONFIDENCE = 0.95
"""Of the intervals that are told."""
CHANCE = 1e-3
"""Probability that something true is flagged at a point, each kind of check and all parameters together."""
MANY_REFUSED = 0.05
"""Share of refused runs from which the others tell of a choice of runs."""
_FEW_SCATTERED = 0.05
"""Share of runs that may state the scatter of segments, as happens by chance, with NEES judged all the same."""
_ROUNDING = 1e-14
"""Error, SI, of what is stated as exact that rounding makes."""
NOT_JUDGED = "not judged: uncertainties from few segments"
Interval = tuple[float, float]


class Coverage(Record):
    """How many runs had the truth in their interval of this level."""

    level: float
    share: float
    interval: Interval
    """Of the probability behind it, 95 %."""


class Judged(Record):
    """One parameter at one point of the grid, SI."""

    name: str
    unit: str
    runs: int
    bias: float
    bias_uncertainty: float | None
    rmse: float
    stated: float
    """Root mean square of the standard uncertainties that the runs state."""
    bound: float | None
    ratio: float | None
    """RMSE over the bound."""
    ratio_interval: Interval | None
    coverage: tuple[Coverage, ...]
    """None of what is stated as exact."""
    flags: tuple[str, ...] = ()
    """What is out of its band, in words."""


class Squares(Record):
    """NEES of the runs at one point: mean, what it should be, and where it then lies with 95 %."""

    mean: float
    expected: float
    band: Interval
    width: float
    """Of a bin of the histogram."""
    histogram: tuple[int, ...]
    """Runs by NEES; the last bin holds all beyond the others."""
    ranks: dict[int, int]
    """Runs by the degrees of freedom of their NEES."""
    remark: str = ""
    """Why it is not judged."""
    flags: tuple[str, ...] = ()


class PointSummary(Record):
    """One point of the grid."""

    values: dict[str, Any]
    runs: int
    """That are done."""
    refused: int
    remark: str = ""
    nees: Squares | None = None
    parameters: tuple[Judged, ...] = ()
    missed: tuple[str, ...] = ()
    """Parameters that no run found, and none should miss."""
    notes: tuple[str, ...] = ()
    """What a reader of the numbers has to know."""

    @property
    def good(self) -> int:
        """Runs that gave a result."""
        return self.runs - self.refused

    @property
    def findings(self) -> tuple[tuple[str, str], ...]:
        """All that is out of its band here: name of the parameter, if it is of one, and what in words."""
        out: list[tuple[str, str]] = []
        if self.refused > MANY_REFUSED * self.runs:
            rest = ": all numbers are of the others alone" if self.good else ""
            out.append(("", f"{self.refused} of {self.runs} runs refused{rest}"))
        out += [("", text) for text in (self.nees.flags if self.nees else ())]
        out += [(name, f"not found in {self.good} of {self.good} runs") for name in self.missed]
        return (*out, *((p.name, text) for p in self.parameters for text in p.flags))


class Refusal(Record):
    """Why runs gave no result, numbers in the text left out."""

    point: int
    reason: str
    runs: int
    first: int
    """One of them."""


class Worst(Record):
    """A run that is far off for what it states."""

    run: int
    point: int
    nees: float
    degrees_of_freedom: int


class Summary(Record):
    """What a simulated campaign came to so far."""

    schema_id: Literal["sagnac/campaign-summary/1"] = Field(default="sagnac/campaign-summary/1", alias="schema")
    kind: Literal["simulation"] = "simulation"
    title: str
    method: str
    seed: int | None
    done: int
    count: int
    points: tuple[PointSummary, ...]
    refusals: tuple[Refusal, ...] = ()
    worst: tuple[Worst, ...] = ()
    software: Software

    @property
    def complete(self) -> bool:
        """Whether all runs are done."""
        return self.done == self.count

    @property
    def flags(self) -> tuple[tuple[int, str], ...]:
        """All that is out of its band: number of the point, and what in words."""
        return tuple(
            (number, f"{name}: {text}" if name else text)
            for number, point in enumerate(self.points)
            for name, text in point.findings
        )


def summarise(tally: Tally) -> Summary:
    """The summary of the rows in a tally."""
    about = tally.about
    return Summary(
        title=about.title,
        method=about.method,
        seed=about.seed,
        done=sum(p.runs for p in tally.points),
        count=about.count,
        points=tuple(_point(tally, number) for number in range(len(about.points))),
        refusals=tuple(
            Refusal(point=point, reason=reason, runs=runs, first=first)
            for (point, reason), (runs, first) in sorted(tally.refusals.items(), key=lambda r: (-r[1][0], r[0]))
        ),
        worst=tuple(
            Worst(run=b.run, point=b.point, nees=b.nees, degrees_of_freedom=b.degrees_of_freedom) for b in tally.worst
        ),
        software=Software(version=__version__),
    )


def loads(text: str, source: str) -> Summary:
    """A summary from JSON text; raises InputError as :func:`sagnac.results.loads` does."""
    return results.loads(Summary, SCHEMA, "the summary of a campaign", text, source)


def json_schema() -> dict[str, Any]:
    """JSON Schema of the file, made from the records above; published as :data:`SCHEMA_FILE`."""
    return results.json_schema(Summary, SCHEMA)


def _point(tally: Tally, number: int) -> PointSummary:
    part, told = tally.points[number], tally.about.points[number]
    good = part.runs - part.refused
    names = [p.name for p in tally.about.parameters]
    return PointSummary(
        values=told.values,
        runs=part.runs,
        refused=part.refused,
        remark=told.remark,
        nees=_squares(part, good, len(names)) if good and part.degrees else None,
        parameters=tuple(_judged(tally, part, told, k) for k in range(len(names)) if part.errors.count[k] > 0),
        missed=tuple(
            n
            for n, sure, count in zip(names, told.sure, part.errors.count, strict=False)
            if sure and good and not count
        ),
        notes=told.notes,
    )


def _squares(part: PointTally, good: int, parameters: int) -> Squares:
    mean = part.nees / good
    low, high = (v / good for v in _chi_square(CONFIDENCE, part.degrees))
    least, most = (v / good for v in _chi_square(1.0 - CHANCE, part.degrees))
    flags = []
    judged = part.scattered <= _FEW_SCATTERED * good
    if judged and mean > most:
        flags.append("NEES is too large: errors are larger than the covariance says")
    if judged and mean < least:
        flags.append("NEES is too small: errors are smaller than the covariance says")
    return Squares(
        mean=mean,
        expected=part.degrees / good,
        band=(low, high),
        width=widest(parameters) / (len(part.histogram) - 1),
        histogram=tuple(part.histogram.tolist()),
        ranks=dict(sorted(part.ranks.items())),
        remark="" if judged else NOT_JUDGED,
        flags=tuple(flags),
    )


class _Column(NamedTuple):
    """Sums of one parameter."""

    runs: int
    bias: float
    spread: float | None
    """Standard uncertainty of the bias."""
    rmse: float
    stated: float
    stated_runs: float
    """So many exact variances are as uncertain as the errors and the stated variances together."""
    bound: float | None
    inside: Array


def _judged(tally: Tally, part: PointTally, told: PointAbout, k: int) -> Judged:
    name, unit = tally.about.parameters[k].name, tally.about.parameters[k].unit
    n = int(part.errors.count[k])
    deviation = math.sqrt(part.errors.squares[k] / (n - 1)) if n > 1 else None
    bound = (told.bound[k] if told.bound else None) or None
    stated = math.sqrt(float(part.variances.mean[k]))
    column = _Column(
        runs=n,
        bias=float(part.errors.mean[k]),
        spread=None if deviation is None else deviation / math.sqrt(n),
        rmse=math.sqrt(float(part.errors.second[k])),
        stated=stated,
        stated_runs=n / (1.0 + float(part.doubt[k]) / n),
        bound=bound if stated else None,  # what is stated as exact has no bound to be measured by
        inside=part.inside[:, k],
    )
    shares = [
        Coverage(level=level, share=float(inside) / n, interval=share_interval(float(inside), n, CONFIDENCE))
        for level, inside in zip(LEVELS, column.inside, strict=True)
        if stated
    ]
    missed = part.runs - part.refused - n
    sure = bool(told.sure) and told.sure[k]
    lost = [f"not found in {missed} of {n + missed} runs"] if sure and missed else []
    confidence = 1.0 - CHANCE / len(tally.about.parameters)
    ratio = column.rmse / column.bound if column.bound else None
    return Judged(
        name=name,
        unit=unit,
        runs=n,
        bias=column.bias,
        bias_uncertainty=column.spread,
        rmse=column.rmse,
        stated=column.stated,
        bound=column.bound,
        ratio=ratio,
        ratio_interval=None if ratio is None else ratio_interval(ratio, n, CONFIDENCE),
        coverage=tuple(shares),
        flags=(*lost, *(_flags(column, confidence) if stated else _exact_flags(column.rmse, unit))),
    )


def _exact_flags(rmse: float, unit: str) -> list[str]:
    """Of what is stated as exact."""
    if rmse <= _ROUNDING:
        return []
    shown, factor = shown_unit(rmse, unit)
    return [f"stated as exact, but is off by {rmse * factor:.3g} {shown}"]


def _flags(column: _Column, confidence: float) -> list[str]:
    """What is out of its band at this confidence; one thing that explains another is told alone."""
    from scipy.special import stdtrit  # of Student's t

    out = []
    if column.spread and abs(column.bias) > stdtrit(column.runs - 1, 0.5 + 0.5 * confidence) * column.spread:
        out.append(f"biased by {abs(column.bias) / column.rmse:.0%} of its RMSE")
    to_bound = _against(column.rmse, column.bound, column.runs, confidence)
    stated = _against(column.rmse, column.stated, column.stated_runs, confidence)
    if to_bound > 0:
        out.append(f"RMSE is {column.rmse / (column.bound or 1.0):.3g} times the bound")
    if stated > 0:
        out.append(f"states too little: RMSE is {column.rmse / column.stated:.3g} times the stated uncertainty")
    if stated < 0:
        out.append(f"states too much: RMSE is {column.rmse / column.stated:.3g} of the stated uncertainty")
    elif to_bound < 0:
        out.append(
            f"RMSE is {column.rmse / (column.bound or 1.0):.3g} of the bound: the truth varies less than is taken for known"
        )
    return out if stated else [*out, *_coverage_flags(column, confidence)]


def _against(rmse: float, sigma: float | None, runs: float, confidence: float) -> int:
    """Whether an RMSE is clearly above (1) or below (-1) a standard deviation, or neither (0)."""
    if not sigma:
        return 0
    low, high = ratio_interval(rmse / sigma, runs, confidence)
    return int(low > 1.0) - int(high < 1.0)


def _coverage_flags(column: _Column, confidence: float) -> list[str]:
    levels, shares = [], []
    for level, inside in zip(LEVELS, column.inside, strict=True):
        low, high = share_interval(float(inside), column.runs, confidence)
        if not low <= level <= high:
            levels.append(f"{100 * level:g}")
            shares.append(f"{100 * inside / column.runs:.1f}")
    return [f"{', '.join(levels)} % intervals hold the truth in {', '.join(shares)} % of the runs"] if levels else []


def _tails(confidence: float) -> Interval:
    return 0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence


def _chi_square(confidence: float, degrees: float) -> Interval:
    """In which a chi-square lies."""
    from scipy.special import gammaincinv

    low, high = (2.0 * float(gammaincinv(0.5 * degrees, tail)) for tail in _tails(confidence))
    return low, high


def ratio_interval(ratio: float, runs: float, confidence: float) -> Interval:
    """Interval of a standard deviation over a known one, from the RMSE of so many runs over it."""
    least, most = _chi_square(confidence, runs)
    return ratio * math.sqrt(runs / most), ratio * math.sqrt(runs / least)


def share_interval(inside: float, runs: int, confidence: float) -> Interval:
    """Interval of a probability from how many of so many runs it came true in (Clopper and Pearson)."""
    from scipy.special import betaincinv

    below, above = _tails(confidence)
    low = float(betaincinv(inside, runs - inside + 1, below)) if inside > 0 else 0.0
    high = float(betaincinv(inside + 1, runs - inside, above)) if inside < runs else 1.0
    return low, high
