"""Alembic runs the migrations on the connection that it is given; there is no other way to run them."""

from __future__ import annotations

from alembic import context

from sagnac.registry.tables import VERSION_TABLE, metadata

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=metadata,
    version_table=VERSION_TABLE,
    transactional_ddl=True,  # SQLite can, where it is told when a transaction begins; all of an upgrade or nothing
)
context.run_migrations()
