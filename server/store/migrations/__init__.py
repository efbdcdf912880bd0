"""The catalogue's versions; Alembic brings an older database up to date when it is opened."""
