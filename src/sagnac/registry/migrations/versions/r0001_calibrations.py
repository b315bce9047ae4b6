"""Units, calibrations with their documents, parameters and values."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from sagnac.registry.migrations.append_only import prepare, refuse_changes

revision = "0001"
down_revision = None

_KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_HASH = sa.String(64).with_variant(sa.String(64, collation="C"), "postgresql")
_NAME = sa.String(200).with_variant(sa.String(200, collation="C"), "postgresql")


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "units",
        sa.Column("id", _KEY, nullable=False),
        sa.Column("model", _NAME, nullable=False),
        sa.Column("serial", _NAME, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_units"),
        sa.UniqueConstraint("serial", "model", name="uq_units_serial_model"),
    )
    op.create_table(
        "calibrations",
        sa.Column("id", _KEY, nullable=False),
        sa.Column("unit_id", _KEY, nullable=False),
        sa.Column("created", sa.BigInteger(), nullable=False),
        sa.Column("method", _NAME, nullable=False),
        sa.Column("misalignment", _NAME, nullable=False),
        sa.Column("software", _NAME, nullable=False),
        sa.Column("sha256", _HASH, nullable=False),
        sa.Column("added", sa.BigInteger(), nullable=False),
        sa.Column("stated", sa.BigInteger(), nullable=True),
        sa.Column("recordings", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_calibrations"),
        sa.ForeignKeyConstraint(["unit_id"], ["units.id"], name="fk_calibrations_unit_id"),
        sa.UniqueConstraint("sha256", name="uq_calibrations_sha256"),
    )
    op.create_index("ix_calibrations_unit_id_created_method", "calibrations", ["unit_id", "created", "method"])
    op.create_table(
        "documents",
        sa.Column("calibration_id", _KEY, nullable=False, autoincrement=False),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("calibration_id", name="pk_documents"),
        sa.ForeignKeyConstraint(["calibration_id"], ["calibrations.id"], name="fk_documents_calibration_id"),
    )
    op.create_table(
        "parameters",
        sa.Column("id", _KEY, nullable=False),
        sa.Column("name", _NAME, nullable=False),
        sa.Column("unit", _NAME, nullable=False),
        sa.Column("misalignment", _NAME, nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_parameters"),
        sa.UniqueConstraint("name", "unit", "misalignment", name="uq_parameters_name_unit_misalignment"),
    )
    op.create_table(
        "values",
        sa.Column("calibration_id", _KEY, nullable=False, autoincrement=False),
        sa.Column("parameter_id", _KEY, nullable=False, autoincrement=False),
        sa.Column("value", sa.Double(), nullable=False),
        sa.Column("standard_uncertainty", sa.Double(), nullable=False),
        sa.Column("dof", sa.Double(), nullable=True),
        sa.PrimaryKeyConstraint("calibration_id", "parameter_id", name="pk_values"),
        sa.ForeignKeyConstraint(["calibration_id"], ["calibrations.id"], name="fk_values_calibration_id"),
        sa.ForeignKeyConstraint(["parameter_id"], ["parameters.id"], name="fk_values_parameter_id"),
        sqlite_with_rowid=False,
    )
    prepare()
    refuse_changes("units", ["id"], ["serial", "model"])
    refuse_changes("calibrations", ["id"], ["sha256"])
    refuse_changes("documents", ["calibration_id"])
    refuse_changes("parameters", ["id"], ["name", "unit", "misalignment"])
    refuse_changes("values", ["calibration_id", "parameter_id"])
