"""Migrations of the catalog's database, by Alembic: one module a version in `versions/`."""
