"""What program made a result."""

from __future__ import annotations

import hashlib
import importlib.metadata
from functools import cache
from pathlib import Path

import resim

_PACKAGES = ("numpy", "scipy", "pandas", "shapely", "numba", "libsumo", "eclipse-sumo")


def versions() -> dict[str, str]:
    """Give the versions of all that a result depends on, resim's own source among them (`code_state`).

    Results of the same versions and inputs are the same; others are neither resumed nor compared as if they were.
    """
    return {"resim": resim.__version__, "code": code_state(), **_packages()}


@cache
def _packages() -> dict[str, str]:
    """Looked up once in a process: each takes about a millisecond."""
    return {name: importlib.metadata.version(name) for name in _PACKAGES}


@cache
def code_state() -> str:
    """Give 16 digits of the hash of resim's source: a version under development changes without a new number.

    What a wheel ships besides (`shipped/`, functions under test among it) is no source of resim's: a checkout has none.
    """
    state = hashlib.sha256()
    root = Path(resim.__file__).parent
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root)
        if path.suffix in (".py", ".json") and name.parts[0] != "shipped":
            state.update(name.as_posix().encode())
            state.update(path.read_bytes())
    return state.hexdigest()[:16]
