"""A document as one HTML file that needs nothing else: no network, no scripts, pictures inside."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from ..files import write_atomically
from .document import Document, plain

if TYPE_CHECKING:
    from jinja2 import Template


def render(document: Document) -> str:
    """The page.

    Parameters
    ----------
    document : Document

    Returns
    -------
    str
        HTML 5. Texts are escaped; only pictures, which are our own SVG, go in as they are. Each JSON attachment is a
        block of data (``<script type="application/json">``, which a browser does not run) and a link to save it.
    """
    content = plain(document)
    for table, attachment in zip(content["attachments"], document.attachments, strict=True):
        table["json"] = _json_block(attachment.data) if attachment.media_type == "application/json" else None
    return _template().render(content)


def save(document: Document, path: str | Path) -> None:
    """Write the page, whole or not at all."""
    text = render(document)
    with write_atomically(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


@lru_cache(maxsize=1)
def _template() -> Template:
    from jinja2 import BaseLoader, Environment, StrictUndefined

    folder = files("sagnac.report") / "templates"
    environment = Environment(
        loader=BaseLoader(), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    style = (folder / "report.css").read_text(encoding="utf-8")
    return environment.from_string((folder / "report.html.jinja").read_text(encoding="utf-8"), globals={"style": style})


def _json_block(data: bytes) -> str:
    """JSON that equals the data and holds nothing that could end the element or open a comment in it."""
    text = json.dumps(json.loads(data), indent=1, ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
