"""The certificate of a calibration: what a laboratory hands over with a unit.

:func:`certificate` makes the document, :func:`write` renders it by the ending of a file.
"""

from __future__ import annotations

from pathlib import Path

from ...calibration import Calibration
from ...errors import InputError
from ...limits import Limits
from ...limits import load as load_limits
from ..document import Document
from .build import certificate
from .details import Details, concerns
from .details import load as load_details
from .evidence import Evidence, gather, hints

__all__ = [
    "Calibration",
    "Details",
    "Evidence",
    "Limits",
    "certificate",
    "check_output",
    "concerns",
    "gather",
    "hints",
    "load_details",
    "load_limits",
    "write",
]

_LISTED = 12
"""Characters that a message names."""


def check_output(path: str | Path, option: str = "--out") -> None:
    """Refuse a file that no report can be written to, before any work is done.

    Raises
    ------
    InputError
        For an ending other than .html, .htm or .pdf, or for a PDF where typst is not installed.
    """
    ending = Path(path).suffix.lower()
    if ending not in (".html", ".htm", ".pdf"):
        raise InputError(f"{option} {path}: a report is written to a .html or .pdf file")
    if ending == ".pdf":
        from ..pdf import check

        check()


def write(document: Document, path: str | Path) -> tuple[str, ...]:
    """Write a document as HTML or PDF by the ending of the file.

    Returns
    -------
    tuple of str
        What the reader will not see as it was written: characters that no font has.

    Raises
    ------
    InputError
        See :func:`check_output`.
    """
    check_output(path)
    if Path(path).suffix.lower() == ".pdf":
        from .. import pdf

        lacking = pdf.save(document, path)
        if not lacking:
            return ()
        listed = " ".join(f"{c} (U+{ord(c):04X})" for c in lacking[:_LISTED])
        more = f" and {len(lacking) - _LISTED} more" if len(lacking) > _LISTED else ""
        return (
            f"no font at hand has {listed}{more}: shown as boxes or �; install a font that has them (Noto, say) or write HTML",
        )
    from .. import html

    html.save(document, path)
    return ()
