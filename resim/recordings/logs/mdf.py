"""Measurements as MDF4: a channel group becomes a table, one row per sample; asammdf reads them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.spelling import did_you_mean
from resim.recordings.logs.apart import read_apart
from resim.recordings.logs.raw import need, no_such_topic

_WRITE = "Write it again as MDF 4 by its tool."


def groups(path: Path) -> dict[str, list[str]]:
    """Give the channel groups of a measurement, each with its channels. Raises InputError."""
    found = _asked(path, None)
    return {str(name): [str(c) for c in channels.tolist()] for name, channels in found.items()}


def group_table(path: Path, group: str, columns: Mapping[str, str], where: str) -> pd.DataFrame:
    """Give the channels of a group as a table, rows numbered from 1, with log_time [ns].

    Args:
        path: The measurement.
        group: Name of the group, or its number.
        columns: Channels that are read, each with the field of the mapping that names it.
        where: The table in the mapping, for errors.

    Raises:
        InputError: The file is damaged, or has no such group or channel.
    """
    found = _asked(path, group)
    if not found:
        raise no_such_topic(path, group, {n: ", ".join(c[:20]) for n, c in groups(path).items()}, where)
    lost = next((name for name in columns if name not in found), None)
    if lost is not None:
        hint = did_you_mean(lost, list(found), cutoff=0.5)
        problem = f"group {group} has no channel {lost!r}, which {columns[lost]} names{hint}"
        raise InputError(path, problem, f"It has {', '.join(list(found)[:200])}.")
    lengths = {len(found[name]) for name in columns}
    if lengths == {0}:
        raise InputError(path, f"group {group} has no sample", "Name a group with samples.")
    frame = pd.DataFrame({name: found[name] for name in columns})
    frame.index = pd.RangeIndex(1, len(frame) + 1)
    return frame


def _asked(path: Path, group: str | None) -> dict[str, np.ndarray]:
    """What the process gives: all groups with their channels, or the channels of one."""
    need(path, "asammdf", "MDF files", "mdf")
    more = [] if group is None else [group]
    return read_apart(path, "resim.recordings.logs.mdf_child", more, what="MDF 4", remedy=_WRITE)
