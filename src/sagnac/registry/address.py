"""Where a registry is: a file, or the URL of a database."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from sqlalchemy import URL

VARIABLE = "SAGNAC_REGISTRY"
_MEANT = re.compile(r"\w{2,}(\+\w+)?:/|[^/\\]*\b(host|hostaddr|user|password|dbname|service)\s*=")
"""How a URL begins that misses a stroke (one letter is a drive), and what the strings of libpq hold: no names of files."""
_HOW = "give a file, or a URL such as postgresql://user@host/database"


@dataclass(frozen=True)
class Address:
    """Where a registry is.

    Attributes
    ----------
    path : Path or None
        The file of SQLite.
    url : sqlalchemy.URL or None
        Of a PostgreSQL server.
    """

    path: Path | None = None
    url: URL | None = None

    def __str__(self) -> str:
        """For messages: without password."""
        if self.url is None:
            return str(self.path)
        shown = self.url.set(
            drivername="postgresql", query={k: v for k, v in self.url.query.items() if "pass" not in k.lower()}
        )
        return shown.render_as_string(hide_password=True)

    @property
    def secrets(self) -> tuple[str, ...]:
        """Texts that no message may hold, longest first."""
        if self.url is None:
            return ()
        from urllib.parse import quote, quote_plus

        found = [str(self.url.password or "")]
        found += [str(v) for k, v in self.url.query.items() if "pass" in k.lower()]
        every = {form for text in found if text for form in (text, quote(text, safe=""), quote_plus(text))}
        return tuple(sorted(every, key=len, reverse=True))


def address(given: str | os.PathLike[str] | None = None) -> Address:
    """Where the registry is that was named.

    Parameters
    ----------
    given : path or URL, optional
        Left out: what the environment variable SAGNAC_REGISTRY says, and without it :func:`default_file`.

    Raises
    ------
    InputError
        For a URL of a database that is not supported.
    """
    text = os.fspath(given) if given is not None else os.environ.get(VARIABLE, "")
    if not text.strip():
        if given is not None:
            raise InputError(f"--registry: it is empty; {_HOW}")
        return Address(default_file())
    if "://" not in text:
        if _MEANT.match(text):  # which may hold a password: nothing of it is told
            raise InputError(f"--registry: neither a file nor a URL, but like one; {_HOW}")
        return Address(Path(text).expanduser())
    return _of_url(text)


def _of_url(text: str) -> Address:
    from sqlalchemy import make_url
    from sqlalchemy.exc import ArgumentError

    kind = text.partition("://")[0]
    if text.count("@") > 1:
        raise InputError(
            f"--registry: the URL ({kind}://...) has more than one @; write %40 for those in a name or password"
        )
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as cause:
        raise InputError(f"--registry: cannot read the URL ({kind}://...); {_HOW}") from cause
    name = url.drivername.partition("+")[0]
    if name == "sqlite":
        if not url.database or url.database == ":memory:":
            raise InputError(f"--registry: the URL names no file; {_HOW}")
        return Address(Path(url.database))
    if name not in ("postgresql", "postgres"):
        raise InputError(f"--registry: a registry is kept in SQLite or PostgreSQL, not in {kind!r}; {_HOW}")
    return Address(url=url.set(drivername="postgresql+psycopg"))


def default_file() -> Path:
    """The registry of this user: in the folder for data of programs, ``~/.local/share/sagnac`` on Linux (XDG_DATA_HOME).

    Raises
    ------
    InputError
        When the user has no home.
    """
    try:
        if sys.platform == "win32":
            folder = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            folder = Path.home() / "Library" / "Application Support"
        else:
            said = Path(os.environ.get("XDG_DATA_HOME", ""))
            folder = said if said.is_absolute() else Path.home() / ".local" / "share"
    except RuntimeError as cause:
        raise InputError(
            f"no home folder to keep the registry in: name a file with --registry or {VARIABLE}"
        ) from cause
    return folder / "sagnac" / "registry.db"
