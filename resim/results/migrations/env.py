"""What Alembic runs: the migrations, on the connection and in the transaction that it is given."""

from alembic import context

from resim.results.tables import METADATA, VERSIONS

context.configure(
    connection=context.config.attributes["connection"], target_metadata=METADATA, version_table=VERSIONS
)
context.run_migrations()
