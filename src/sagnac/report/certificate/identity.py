"""Who, what and when; the result at a glance; what a certificate has to state."""

from __future__ import annotations

from ... import limits as rules
from ..document import Block, Bullets, Facts, Grid, Section, Text, Verdict
from ..shown import NOT_STATED, moment, or_not_stated, percent, plain_words
from .conditions import KEYS
from .context import Context
from .details import concerns
from .methods import method_of

_PROBABILITY = 0.01  # of the fit's chi-square, below which a word is due


def identification(context: Context) -> Section:
    """The unit, the laboratory, the customer and the dates (ISO/IEC 17025:2017, 7.8.2.1)."""
    d, calibration = context.details, context.calibration
    item = ", ".join(t for t in (calibration.unit.model, d.item.description) if t.strip())
    rows = (
        ("Certificate number", d.number),
        ("Item", item),
        ("Manufacturer", d.item.manufacturer),
        ("Serial number", calibration.unit.serial),
        ("Condition of the item", d.item.condition),
        ("Laboratory", "\n".join(t for t in (d.laboratory.name, d.laboratory.address) if t)),
        ("Contact", d.laboratory.contact),
        ("Accreditation", d.laboratory.accreditation),
        ("Customer", "\n".join(t for t in (d.customer.name, d.customer.address, d.customer.contact) if t)),
        ("Item received", d.item.received),
        ("Calibrated", d.calibrated),
        ("Place of calibration", d.place),
        ("Data evaluated", moment(calibration.created)),
        ("Certificate issued", d.issued),
        ("Calibrated by", d.operator),
        ("Approved by", ", ".join(t for t in (d.approved_by, d.approver_function) if t)),
    )
    return Section("Identification", (Facts(tuple((a, or_not_stated(b)) for a, b in rows)),))


def summary(context: Context) -> Section:
    """What came out, in a few lines."""
    calibration = context.calibration
    fit = calibration.fit
    method = method_of(calibration).title
    text = f"{len(calibration.parameters)} parameters by the method {method}."
    if fit.degrees_of_freedom == 0:
        text += " As many readings as unknowns: nothing is left to judge the fit by."
    else:
        text += f" Chi-square of the fit {fit.chi2:.4g} for {fit.degrees_of_freedom} degrees of freedom"
        text += "." if fit.p_value is None else f", probability {_probability(fit.p_value)}."
    blocks: list[Block] = [Text(text), *_conformity(context), *_verified(context)]
    if fit.p_value is not None and fit.p_value < _PROBABILITY:
        blocks.append(
            Text(
                "The noise does not explain the scatter between segments. The uncertainties stated are those that "
                "the scatter shows, "
                "see the method."
                if "white" not in fit.uncertainty
                else "The noise does not explain all of the scatter between segments; see the method for what the uncertainties "
                "rest on."
            )
        )
    blocks += [Text(f"{w[:1].upper()}{w[1:]}.", "warning") for w in concerns(context.details, calibration)]
    if calibration.remarks:
        blocks.append(Text("The calibration carries remarks, which belong to the result; see there.", "note"))
    return Section("Summary", tuple(blocks))


def _probability(p: float) -> str:
    return percent(p) if p >= 0.0005 else f"{p:.1g}"


def _conformity(context: Context) -> list[Block]:
    if not context.decisions or context.limits is None:
        return [Text("No limits were given: no statement of conformity is made.", "note")]
    passed = rules.outcome(context.decisions)
    counts = [
        f"{sum(d.passed is state for d in context.decisions.values())} {word}"
        for state, word in ((True, "pass"), (False, "fail"), (None, "undecided"))
    ]
    spec = f", {context.limits.specification}" if context.limits.specification else ""
    of = f"{len(context.decisions)} of {len(context.calibration.parameters)} parameters have limits"
    return [Verdict(passed, f"Conformity with the limits{spec}, by {context.limits.rule}: {', '.join(counts)}; {of}.")]


def _verified(context: Context) -> list[Block]:
    outcome = context.evidence.verification
    if outcome is None:
        return []
    text = (
        f"Verification on a recording that the fit has not seen: chi-square {outcome.chi2:.4g} for "
        f"{outcome.degrees_of_freedom} degrees of "
        f"freedom, probability {_probability(outcome.p_value)}."
    )
    return [Verdict(outcome.passed, text)]


def traceability(context: Context) -> Section:
    """The statement of traceability and the standards used."""
    d = context.details
    blocks: list[Block] = [
        Text(d.traceability) if d.traceability else Text(f"Metrological traceability: {NOT_STATED}.")
    ]
    if d.standard:
        rows = tuple(
            tuple(or_not_stated(t) for t in (s.name, s.identifier, s.certificate, s.issued_by, s.valid_until))
            for s in d.standard
        )
        header = ("standard or instrument", "identifier", "certificate", "issued by", "valid until")
        blocks.append(Grid(header, rows, "lllll", "Standards and instruments used"))
    else:
        blocks.append(Text(f"Standards and instruments used: {NOT_STATED}."))
    blocks += [Text(f"{w[:1].upper()}{w[1:]}.", "warning") for w in concerns(d, context.calibration)]
    source = context.calibration.site.gravity_source or NOT_STATED
    rests = [
        text.format(gravity=source)
        for sensor, text in method_of(context.calibration).rests.items()
        if any(p.name.startswith(f"{sensor}.") for p in context.calibration.parameters)
    ]
    if rests:
        blocks.append(Text(" ".join(rests), "note"))
    return Section("Traceability", tuple(blocks))


def statements(context: Context) -> Section:
    """What ISO/IEC 17025:2017 (7.8.2, 7.8.4) and the GUM ask a certificate to state."""
    items = [
        "The results relate only to the item calibrated, under the conditions in which it was calibrated.",
        "This certificate shall not be reproduced except in full without the approval of the laboratory.",
        "Uncertainties are expanded by the coverage factor stated under Results, and evaluated according to the GUM.",
        (
            "The uncertainty is that of the calibration. It contains no allowance for changes of the item afterwards: "
            "transport, ageing, scatter from turn-on to turn-on, temperatures other than that of the calibration."
        ),
        f"Adjustment or repair of the item: {or_not_stated(context.details.item.adjustment)}. "
        + (
            "The results before and after it are in the section As found, as left."
            if context.evidence.as_found is not None
            else "No results before an adjustment are reported."
        ),
        "No recommendation on the interval of calibration is made.",
    ]
    return Section("Statements", (Bullets(tuple(items)), *_own_remarks(context)))


def _own_remarks(context: Context) -> list[Block]:
    given = context.details.remarks
    return [Text("Remarks of the laboratory:"), Bullets(given)] if given else []


def remarks(context: Context) -> Section | None:
    """What the calibration says of itself."""
    given = context.calibration.remarks
    return (
        Section("Remarks of the calibration", (Bullets(tuple(plain_words(r, KEYS) for r in given)),)) if given else None
    )
