"""The process that reads a Feather file (Arrow's IPC format): FILE OUT COLUMN..."""

from __future__ import annotations

import numpy as np

from resim.recordings.logs.apart import serve
from resim.recordings.logs.limits import MOST_CELLS


def read(path: str, *columns: str) -> dict[str, np.ndarray]:
    """Give the columns of these names that are there."""
    from pyarrow import feather, types

    table = feather.read_table(path, memory_map=False)
    if table.num_rows * len(columns) > MOST_CELLS:
        raise ValueError(f"{table.num_rows} rows are too many, up to {MOST_CELLS} values")
    found = {}
    for name in columns:
        if table.schema.names.count(name) != 1:
            continue
        column = table.column(name)
        kind = column.type.value_type if types.is_dictionary(column.type) else column.type
        if types.is_integer(kind) and not column.null_count:
            found[name] = column.to_numpy()
        elif types.is_floating(kind) or types.is_integer(kind):
            found[name] = column.to_numpy().astype(float)
        else:
            found[name] = np.array(["" if v is None else str(v) for v in column.to_pylist()], dtype=str)
    return found


if __name__ == "__main__":
    serve(read)
