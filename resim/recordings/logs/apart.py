"""Files that a library of others reads in a process of its own, with limits of memory and time.

A damaged file can make such a library run in circles or take all memory; and libsumo brings a library of Arrow's,
beside which pyarrow should not be loaded.
"""

from __future__ import annotations

import math
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from resim.core.errors import InputError
from resim.core.files import open_file

SECONDS, PER_MEGABYTE = 60.0, 1.0
"""Time that a file is given: at least, and by its size."""
MEMORY, TIMES = 3 << 30, 8
"""Bytes that the process may have: at least, and times the size of the file."""


def read_apart(
    path: Path, module: str, more: Sequence[str], *, what: str, remedy: str
) -> dict[str, np.ndarray]:
    """Give the arrays that a module's `serve` makes of a file, by their names.

    more: what the module is told beside the file; what: the kind of file, for errors. Raises InputError where reading
    fails, crashes or takes too long.
    """
    open_file(path, "Check the path").close()
    seconds = math.ceil(SECONDS + PER_MEGABYTE * path.stat().st_size / 1e6)
    with tempfile.TemporaryDirectory(prefix="resim-") as folder:
        out = Path(folder) / "found.npz"
        command = [sys.executable, "-m", module, str(path.absolute()), str(out), *more]
        try:
            done = subprocess.run(
                command, capture_output=True, timeout=seconds, check=False, stdin=subprocess.DEVNULL,
                env={**os.environ, "TMPDIR": folder},  # what the library leaves behind goes with the folder
            )  # fmt: skip
        except subprocess.TimeoutExpired as e:
            raise InputError(
                path, f"was not read within {seconds} s: it is damaged, or too large", remedy
            ) from e
        if not out.is_file():
            words = done.stderr.decode("utf-8", "replace").strip().splitlines() or ["reading crashed"]
            raise InputError(path, f"is damaged or incomplete, or no {what} file ({words[-1][:200]})", remedy)
        with np.load(out, allow_pickle=False) as arrays:
            first, *others = (arrays[name] for name in arrays.files)
            return dict(zip(first.tolist(), others, strict=True))


def serve(read: Callable[..., Mapping[str, np.ndarray]]) -> None:
    """Be the process: write what `read` gives of the file, or end with a line on the standard error."""
    path, out, *more = sys.argv[1:]
    try:
        most = MEMORY + TIMES * Path(path).stat().st_size
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
        found = read(path, *more)
        beside = Path(f"{out}.tmp.npz")
        np.savez(beside, np.array(list(found), dtype=str), *found.values())
        beside.replace(out)
    except BaseException as e:
        sys.stderr.write(f"\n{type(e).__name__}: {' '.join(str(e).split())[:200]}\n")
        sys.stderr.flush()
        os._exit(1)
