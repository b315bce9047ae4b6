"""Registries to test on: SQLite, and PostgreSQL on a server of the tests' own."""

from __future__ import annotations

import itertools
import os

import pytest
from postgresql_server import NoServerError, server
from sqlalchemy import create_engine, make_url, text

_NUMBERS = itertools.count()


@pytest.fixture(scope="session")
def postgresql():
    """URL of a PostgreSQL database, that of SAGNAC_TEST_POSTGRESQL or of a server made for this session."""
    given = os.environ.get("SAGNAC_TEST_POSTGRESQL")
    if given:
        yield given
        return
    try:
        with server() as url:
            yield url
    except NoServerError as cause:
        if os.environ.get("CI", "").lower() in ("1", "true"):
            raise
        pytest.skip(f"no PostgreSQL server: {cause}")


@pytest.fixture
def schema(postgresql):
    """URL of an empty schema in that database: a database of a test's own, in a tenth of the time."""
    name = f"test_{os.getpid()}_{next(_NUMBERS)}"
    engine = create_engine(make_url(postgresql).set(drivername="postgresql+psycopg"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(text(f"CREATE SCHEMA {name}"))
    yield make_url(postgresql).update_query_dict({"options": f"-csearch_path={name}"}).render_as_string(False)
    with engine.connect() as connection:
        connection.execute(text(f"DROP SCHEMA {name} CASCADE"))
    engine.dispose()


@pytest.fixture(params=["sqlite", "postgresql"])
def where(request, tmp_path):
    """Where a registry can be made: a file, and a schema of a PostgreSQL database."""
    return str(tmp_path / "fleet.db") if request.param == "sqlite" else request.getfixturevalue("schema")
