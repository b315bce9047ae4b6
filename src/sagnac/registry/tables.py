"""The tables of a registry, as the last migration leaves them.

Times are microseconds since 1970-01-01 UTC: whole numbers, which both databases compare, index and keep exactly. Nothing that is
in a table is ever changed or removed: triggers refuse it (see the migrations).
"""

from __future__ import annotations

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
)

from .entries import LONGEST

REVISIONS = ("0001", "0002")
"""Of the migrations, oldest first; the tables below are those of the last."""
VERSION_TABLE = "sagnac_registry"
"""Holds the revision that a database is at."""

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)
_KEY = BigInteger().with_variant(Integer, "sqlite")  # SQLite numbers rows of INTEGER keys only
_HASH = String(64).with_variant(String(64, collation="C"), "postgresql")
_NAME = String(LONGEST).with_variant(
    String(LONGEST, collation="C"), "postgresql"
)  # in the order of SQLite, on any server

units = Table(
    "units",
    metadata,
    Column("id", _KEY, primary_key=True),
    Column("model", _NAME, nullable=False),
    Column("serial", _NAME, nullable=False),
    UniqueConstraint("serial", "model"),
)

calibrations = Table(
    "calibrations",
    metadata,
    Column("id", _KEY, primary_key=True),
    Column("unit_id", _KEY, ForeignKey("units.id"), nullable=False),
    Column("created", BigInteger, nullable=False),
    Column("method", _NAME, nullable=False),
    Column("misalignment", _NAME, nullable=False),
    Column("software", _NAME, nullable=False),
    Column("sha256", _HASH, nullable=False, unique=True),
    Column("added", BigInteger, nullable=False),
    Column("stated", BigInteger),  # the date in the file, where created may be another
    Column("recordings", Text, nullable=False),  # their SHA-256, with blanks between
    Index(None, "unit_id", "created", "method"),  # all that a list of the fleet asks for
)

documents = Table(  # beside the calibrations: a list does not have to read past them
    "documents",
    metadata,
    Column("calibration_id", _KEY, ForeignKey("calibrations.id"), primary_key=True, autoincrement=False),
    Column("content", LargeBinary, nullable=False),
)

parameters = Table(
    "parameters",
    metadata,
    Column("id", _KEY, primary_key=True),
    Column("name", _NAME, nullable=False),
    Column("unit", _NAME, nullable=False),
    Column("misalignment", _NAME, nullable=False),
    UniqueConstraint("name", "unit", "misalignment"),
)

values = Table(  # kept in the order of its key: the values of a calibration lie together
    "values",
    metadata,
    Column("calibration_id", _KEY, ForeignKey("calibrations.id"), primary_key=True, autoincrement=False),
    Column("parameter_id", _KEY, ForeignKey("parameters.id"), primary_key=True, autoincrement=False),
    Column("value", Double, nullable=False),
    Column("standard_uncertainty", Double, nullable=False),
    Column("dof", Double),  # degrees of freedom of the standard uncertainty; none where the noise was known
    sqlite_with_rowid=False,
)

limits = Table(
    "limits",
    metadata,
    Column("id", _KEY, primary_key=True),
    Column("model", _NAME, nullable=False),
    Column("serial", _NAME, nullable=False),  # empty: of all units of the model
    Column("key", _NAME, nullable=False),  # a parameter or a pattern
    Column("lower", Double),
    Column("upper", Double),
    Column("unit", _NAME, nullable=False),
    Column("rule", _NAME, nullable=False),
    Column("specification", _NAME, nullable=False),
    Column("valid_from", BigInteger, nullable=False),
    Column("added", BigInteger, nullable=False),
    Index(None, "model", "serial"),
)
