"""The process that reads an MDF file: FILE OUT [GROUP]."""

from __future__ import annotations

from typing import Any

import numpy as np

from resim.recordings.logs.apart import serve
from resim.recordings.logs.flat import LOG_TIME
from resim.recordings.logs.limits import MOST_CELLS

VARIABLE_LENGTH = 1
"""Flag of a channel group."""
MOST_WIDE = 64
"""Numbers of a channel's array that become columns of their own."""


def read(path: str, *group: str) -> dict[str, np.ndarray]:
    """Give the channels of a group, {} where there is none of this name; without one all groups' channels."""
    import asammdf

    with asammdf.MDF(path, raise_on_multiple_occurrences=False) as measurement:
        if not measurement.version.startswith("4"):
            raise ValueError(f"it is MDF {measurement.version}: save it as MDF 4")
        names = _names(measurement)
        if not group:
            return {name: np.array(_channels(measurement, n), dtype=str) for n, name in enumerate(names)}
        number = _numbered(names, group[0])
        return {} if number is None else _samples(measurement, number)


def _names(measurement: Any) -> list[str]:
    """The groups' names: those of their acquisition where they have one of their own, else their numbers from 1."""
    told = [str(group.channel_group.acq_name or "").strip() for group in measurement.groups]
    return [name if name and told.count(name) == 1 else str(n + 1) for n, name in enumerate(told)]


def _numbered(names: list[str], group: str) -> int | None:
    if group in names:
        return names.index(group)
    return int(group) - 1 if group.isascii() and group.isdigit() and 0 < int(group) <= len(names) else None


def _channels(measurement: Any, number: int) -> list[str]:
    return [LOG_TIME, *(channel.name for channel in measurement.groups[number].channels)]


def _samples(measurement: Any, number: int) -> dict[str, np.ndarray]:
    """All channels of a group, and the time of its samples [ns], since 1970 where the file says when it began."""
    count = measurement.groups[number].channel_group.cycles_nr
    channels = measurement.groups[number].channels
    if count * len(channels) > MOST_CELLS:
        raise ValueError(
            f"{count} samples of {len(channels)} channels are too many, up to {MOST_CELLS} values"
        )
    _check_count(measurement.groups[number], count)
    signals = measurement.select([(None, number, n) for n in range(len(channels))], raw=False)
    found: dict[str, np.ndarray] = {}
    for channel, signal in zip(channels, signals, strict=True):
        bits = signal.invalidation_bits
        invalid = None if bits is None else np.asarray(bits, dtype=bool)
        _take(found, channel.name, np.asarray(signal.samples), invalid)
    if signals:
        times = np.asarray(signals[0].timestamps, dtype=float)
        if not np.isfinite(times).all() or (np.abs(times) > 1e9).any():
            raise ValueError("its times are no seconds")
        found[LOG_TIME] = int(measurement.header.abs_time) + np.round(times * 1e9).astype("int64")
    return found


def _check_count(group: Any, count: int) -> None:
    """Raise ValueError where a group has not as many samples as it counts: asammdf would make up those that lack.

    Not looked at: groups of values of variable length, of records with ids, and of columns.
    """
    head = group.channel_group
    size = head.samples_byte_nr + head.invalidation_bytes_nr
    if not size or head.flags & VARIABLE_LENGTH or group.data_group.record_id_len or group.uses_ld:
        return
    there = max(0, sum(block.original_size for block in group.get_data_blocks())) // size
    if there != count:
        raise ValueError(f"{count} samples are counted and {there} are there: it was not written to its end")


def _take(found: dict[str, np.ndarray], name: str, samples: np.ndarray, invalid: np.ndarray | None) -> None:
    """Take a channel: numbers and texts as they are, structures and arrays by their parts.

    invalid: which of its samples the file says are not valid, None where all are. They become NaN, texts "".
    """
    if samples.dtype.names:
        for inner in samples.dtype.names:
            _take(found, name if inner == name else f"{name}.{inner}", samples[inner], invalid)
    elif samples.ndim == 2 and samples.dtype.kind in "fiub" and samples.shape[1] <= MOST_WIDE:
        for n in range(samples.shape[1]):
            _take(found, f"{name}.{n}", samples[:, n], invalid)
    elif samples.ndim == 1 and samples.dtype.kind == "S":
        texts = np.array([s.decode("utf-8", "replace").strip("\0 ") for s in samples], dtype=str)
        _take(found, name, texts, invalid)
    elif samples.ndim == 1 and samples.dtype.kind in "fiubU":
        found.setdefault(
            name, samples if invalid is None or not invalid.any() else _without(samples, invalid)
        )


def _without(samples: np.ndarray, invalid: np.ndarray) -> np.ndarray:
    """Samples with NaN, or "" of texts, in place of those that are not valid."""
    if samples.dtype.kind == "U":
        return np.where(invalid, "", samples)
    return np.where(invalid, np.nan, samples.astype(float))


if __name__ == "__main__":
    serve(read)
