"""Migrations of a registry: what Alembic does to a database, from one revision to the next."""
