"""Limits of parameters, by model or unit and from a date on."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from sagnac.registry.migrations.append_only import refuse_changes

revision = "0002"
down_revision = "0001"

_KEY = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_NAME = sa.String(200).with_variant(sa.String(200, collation="C"), "postgresql")


def upgrade() -> None:
    """Make the table."""
    op.create_table(
        "limits",
        sa.Column("id", _KEY, nullable=False),
        sa.Column("model", _NAME, nullable=False),
        sa.Column("serial", _NAME, nullable=False),
        sa.Column("key", _NAME, nullable=False),
        sa.Column("lower", sa.Double(), nullable=True),
        sa.Column("upper", sa.Double(), nullable=True),
        sa.Column("unit", _NAME, nullable=False),
        sa.Column("rule", _NAME, nullable=False),
        sa.Column("specification", _NAME, nullable=False),
        sa.Column("valid_from", sa.BigInteger(), nullable=False),
        sa.Column("added", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_limits"),
    )
    op.create_index("ix_limits_model_serial", "limits", ["model", "serial"])
    refuse_changes("limits", ["id"])
