"""What a calibration has gained: residuals of a recording without it, or with an earlier one, and with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...errors import DataError, SagnacError
from ...observe.static import THRESHOLD
from ...verification import Check, verify

if TYPE_CHECKING:
    from ...calibration import Calibration
    from ...plan import Plan
    from ...recording import Recording

_KEPT = ("rig.encoder_delay", "rig.cone_phase", "rig.lever_arm", "rig.tilt", "rig.zero", "rig.nonperpendicularity")
"""What is of the rig and not of the unit: the same before and after. (A cone of no angle has no phase.)"""

_NOTHING = 1e-6  # standard uncertainties


@dataclass(frozen=True)
class Pair:
    """One quantity of one segment, SI: what is left before and after, and its standard uncertainty afterwards."""

    segment: str
    what: str
    before: float
    after: float
    standard_uncertainty: float
    unit: str


@dataclass(frozen=True)
class Comparison:
    """Residuals before and after.

    Attributes
    ----------
    pairs : tuple of Pair
    before, after : str
        What was applied, in words.
    checks : tuple of Check
        Those afterwards.
    """

    pairs: tuple[Pair, ...]
    before: str
    after: str
    checks: tuple[Check, ...]

    def rms(self, what: str) -> tuple[float, float]:
        """Root mean squares of a quantity before and after, SI.

        Parameters
        ----------
        what : str
        """
        own = [p for p in self.pairs if p.what == what]
        if not own:
            raise KeyError(what)
        return (
            math.sqrt(sum(p.before**2 for p in own) / len(own)),
            math.sqrt(sum(p.after**2 for p in own) / len(own)),
        )


def nominal(calibration: Calibration) -> Calibration:
    """The same unit without errors: what its data sheet says of it.

    Readings in counts have no data sheet here; one gain for all axes of a triad and square axes stand for it, with the biases of
    the calibration, without which counts say nothing.

    Parameters
    ----------
    calibration : Calibration
    """
    gains: dict[str, list[float]] = {}
    for p in calibration.parameters:
        sensor, _, rest = p.name.partition(".")
        if rest.startswith("scale_factor."):
            gains.setdefault(sensor, []).append(p.value)

    def value(name: str, own: float) -> float:
        sensor, _, rest = name.partition(".")
        if name.startswith(_KEPT) or (sensor in gains and rest.startswith("bias.")):
            return own
        if rest.startswith("scale_factor."):
            return sum(gains[sensor]) / len(gains[sensor])
        return 0.0

    changed = tuple(p.model_copy(update={"value": value(p.name, p.value)}) for p in calibration.parameters)
    return calibration.model_copy(update={"parameters": changed})


def comparison(
    calibration: Calibration,
    recording: Recording,
    plan: Plan | None,
    earlier: Calibration | None = None,
    *,
    threshold: float = THRESHOLD,
) -> Comparison:
    """What each segment of a recording leaves over before and after.

    Parameters
    ----------
    calibration : Calibration
    recording : Recording
        Best one that the fit has not seen.
    plan : Plan, optional
        Of the recording; without segments the static intervals are found as for a hand-turned unit.
    earlier : Calibration, optional
        What was applied before; otherwise the unit without errors (see :func:`nominal`).
    threshold : float
        Of static intervals, see :func:`sagnac.observe.static.static_intervals`.

    Returns
    -------
    Comparison

    Raises
    ------
    DataError
        When there is nothing to compare.
    InputError
        When units do not match, see :func:`sagnac.verification.verify`.
    """
    after = verify(calibration, recording, plan, threshold=threshold).checks
    if earlier is not None:
        words = "with the earlier calibration"
    elif any(".scale_factor." in p.name for p in calibration.parameters):
        words = "with the biases and one gain for all axes"
    else:
        words = "uncalibrated"
    try:
        before = verify(earlier or nominal(calibration), recording, plan, threshold=threshold).checks
    except SagnacError as error:
        if earlier is not None:
            raise
        rig = "turntable" if plan is None else plan.rig.kind.replace("-", " ")
        raise DataError(
            f"{recording.name}: without this calibration the readings are too far from the model of the {rig} to be judged, so "
            "that there is no picture of before and after; one against an earlier calibration can be drawn (--earlier)"
        ) from error
    refuse_nothing(calibration, after)
    pairs = _paired(before, after)
    if not pairs:
        raise DataError(f"{recording.name}: nothing in it can be compared before and after")
    return Comparison(pairs, words, "with this calibration", after)


def refuse_nothing(calibration: Calibration, checks: Sequence[Check]) -> None:
    """Refuse residuals that are zero by construction: the same result from the same readings.

    Parameters
    ----------
    calibration : Calibration
    checks : sequence of Check
        What the recording shows against it.

    Raises
    ------
    DataError
        When they are.
    """
    if checks and all(abs(c.z) < _NOTHING for c in checks):
        raise DataError(
            f"a recording by {calibration.method} has no residuals against its own calibration: they are zero by construction; "
            "give another recording of the unit (--recording, --plan)"
        )


def _paired(before: Sequence[Check], after: Sequence[Check]) -> tuple[Pair, ...]:
    """Checks of the same quantity of the same segment; several components go by their order."""
    waiting: dict[tuple[str, str], list[Check]] = {}
    for c in before:
        waiting.setdefault((c.segment, c.what), []).append(c)
    out = []
    for c in after:
        first = waiting.get((c.segment, c.what))
        if first:
            old = first.pop(0)
            out.append(Pair(c.segment, c.what, old.residual, c.residual, c.standard_uncertainty, c.unit))
    return tuple(out)
