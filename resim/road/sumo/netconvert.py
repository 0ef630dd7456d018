"""Runs netconvert, and puts every way in which it can fail into words."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import subprocess
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType

from resim.core.errors import ConversionError

OPTIONS = (
    "--precision", "6", "--offset.disable-normalization", "--no-turnarounds", "--default.junctions.radius", "0",
    "--junctions.small-radius", "0", "--junctions.endpoint-shape", "--no-warnings", "--ignore-errors.connections",
)  # fmt: skip
NO_NAMES: Mapping[str, str] = MappingProxyType({})
INSTALL = "Install eclipse-sumo of the version in pyproject.toml"
LIBRARIES = "Install libX11, libXext, libXrender, libGL, libatomic and libexpat from the system's packages"
SIMPLIFY = "Look at the map there in an OpenDRIVE editor, or use another map"


def sumo_version() -> str:
    """Give the version of SUMO; raises ConversionError where it is not installed."""
    try:
        return version("eclipse-sumo")
    except PackageNotFoundError:
        raise ConversionError(f"netconvert: the package eclipse-sumo is not installed. {INSTALL}") from None


def run_netconvert(
    xodr: Path, arguments: list[str], net: Path, *, time_limit: float, names: Mapping[str, str] = NO_NAMES
) -> None:
    """Run netconvert so that it writes `net`; `xodr` names the map in errors. time_limit: s.

    A connection that netconvert cannot make is left out, without an error. names: of the net's elements, by SUMO's
    ids, for errors in the map's own terms.

    Raises ConversionError where netconvert is missing, refuses, crashes or takes too long.
    """
    home = _sumo_home()
    proj = str(home / "data" / "proj")
    environment = {**os.environ, "SUMO_HOME": str(home), "PROJ_DATA": proj, "PROJ_LIB": proj}
    command = [str(home / "bin" / "netconvert"), *arguments, "-o", str(net), *OPTIONS]
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, errors="replace", timeout=time_limit,
            stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        text = f"{xodr}: netconvert was stopped after {time_limit:g} s without a result. {SIMPLIFY}."
        raise ConversionError(text) from None
    except OSError as error:
        raise ConversionError(f"netconvert cannot be started ({error.strerror}). {INSTALL}.") from None
    if done.returncode != 0 or not net.is_file():
        said = re.sub(r"'([^']*)'", lambda found: names.get(found[1], found[0]), done.stderr)
        raise _failure(xodr, done.returncode, said)


def _sumo_home() -> Path:
    """The folder of the installed package `sumo`, found without importing it."""
    found = importlib.util.find_spec("sumo")
    home = Path(found.origin).parent if found and found.origin else None
    if home is None or not (home / "bin").is_dir():
        raise ConversionError(f"netconvert: no sumo package with a bin folder is installed. {INSTALL}")
    return home


def _failure(xodr: Path, code: int, said: str) -> ConversionError:
    """Put a failed run of netconvert into words."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    if "error while loading shared libraries" in said:
        return ConversionError(f"netconvert cannot start: {lines[-1]}. {LIBRARIES}.")
    if code < 0 or code > 128:
        number = -code if code < 0 else code - 128
        name = signal.Signals(number).name if number in set(signal.Signals) else str(number)
        last = f", after saying {lines[-1]!r}" if lines else ""
        return ConversionError(f"{xodr}: netconvert crashed on this map ({name}){last}. {SIMPLIFY}.")
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error")]
    told = [line for line in errors if " total messages of type" not in line] or errors
    last = told[-1].rstrip(".") if told else f"exit code {code}"
    return ConversionError(f"{xodr}: netconvert refuses this map: {last}. {SIMPLIFY}.")
