"""A topic of a log as a table: one row per message, or per element of its list."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.core.spelling import did_you_mean
from resim.recordings.logs.decoders import decoder
from resim.recordings.logs.flat import LOG_TIME, RowTable, list_at, rows_of, wanted_of
from resim.recordings.logs.kinds import LogKind
from resim.recordings.logs.mcap_file import mcap_messages
from resim.recordings.logs.mdf import group_table, groups
from resim.recordings.logs.raw import LogChannel, RawMessage, no_such_topic
from resim.recordings.logs.rosbag import db3_messages, folder_messages

_LOOKED_AT = 200
"""Messages that are looked at for the names of their fields."""
_READERS: Mapping[str, Callable[[Path, str | None], Iterator[RawMessage]]] = {
    "mcap": mcap_messages,
    "db3": db3_messages,
    "folder": folder_messages,
}


def topics(path: Path, kind: LogKind) -> dict[str, str]:
    """Give the topics of a log with messages, each with its type; of MDF the channel groups, each with its channels."""
    if kind == "mdf":
        return {name: ", ".join(channels[:20]) for name, channels in groups(path).items()}
    return {one.channel.topic: one.channel.type for one in _READERS[kind](path, None)}


@dataclass(frozen=True)
class TopicQuery:
    """What is wanted of a log.

    Attributes:
        topic: Whose messages are read; None: the mapping names none.
        list: Dotted path of the list whose elements are the rows; None: a message is a row.
        columns: Those that are read, each with the field of the mapping that names it.
        where: The table in the mapping, for errors.
        distribution: ROS distribution whose definitions are taken where the log has none.
    """

    topic: str | None
    list: str | None
    columns: Mapping[str, str]
    where: str
    distribution: str | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        """The path of the list, () for none."""
        return tuple(self.list.split(".")) if self.list else ()


def topic_table(path: Path, kind: LogKind, query: TopicQuery) -> pd.DataFrame:
    """Give the columns of a topic as a table, rows numbered from 1 in the order of the log.

    Raises InputError where the log is damaged, or has no such topic, list or column.
    """
    if query.topic is None:
        raise no_such_topic(path, None, topics(path, kind), query.where)
    if kind == "mdf":
        if query.list is not None:
            problem = f"{query.where}.list is {query.list!r}, but channels have no list"
            raise InputError(path, problem, "Leave it out.")
        return group_table(path, query.topic, query.columns, query.where)
    table = RowTable(frozenset(query.columns))
    count = 0
    for row in _rows(path, _READERS[kind](path, query.topic), query, list(query.columns)):
        if row is None:
            count += 1
        else:
            _add(path, table, row)
    if not count:
        raise no_such_topic(path, query.topic, topics(path, kind), query.where)
    if not table.count:
        problem = f"{query.where}: {query.list} is empty in all {count} messages of {query.topic}"
        raise InputError(path, problem, "Name a topic in which objects are.")
    lost = next((name for name in query.columns if name not in table.names), None)
    if lost is not None:
        raise _no_such_column(path, kind, query, lost)
    return table.frame()


def _no_such_column(path: Path, kind: LogKind, query: TopicQuery, lost: str) -> InputError:
    """The error for a column that no message has."""
    there = _names(path, _READERS[kind](path, query.topic), query)
    known = lost in there
    hint = "" if known else did_you_mean(lost, there, cutoff=0.5)
    what = f"{query.topic} has no {'value of' if known else 'field'} {lost!r}"
    return InputError(path, f"{what}, which {query.columns[lost]} names{hint}", f"It has {', '.join(there)}.")


def _add(path: Path, table: RowTable, row: Mapping[str, object]) -> None:
    try:
        table.add(row)
    except ValueError as e:
        raise InputError(path, str(e), "Cut the log to the drive.") from e


def _rows(
    path: Path, messages: Iterator[RawMessage], query: TopicQuery, columns: list[str] | None
) -> Iterator[dict[str, object] | None]:
    """The rows of messages, and None at the end of each message; columns: that are wanted, None for all."""
    parts = query.parts
    wanted = None if columns is None else wanted_of(columns, parts)
    known: dict[LogChannel, Callable[[bytes], object]] = {}
    for one in messages:
        if first := one.channel not in known:
            known[one.channel] = decoder(path, one.channel, wanted, parts, query.distribution)
        try:
            if first and parts:  # all of the message, as an error names what is there
                list_at(decoder(path, one.channel, None, parts, query.distribution)(one.body), parts)
            for row in rows_of(known[one.channel](one.body), parts):
                yield row | {LOG_TIME: one.log_time}
        except ValueError as e:
            text = " ".join(str(e).split())[:300]
            remedy = "Check `list` in the mapping; if the log is damaged, record it again."
            raise InputError(path, f"{one.where}: {text}", remedy) from e
        yield None


def _names(path: Path, messages: Iterator[RawMessage], query: TopicQuery) -> list[str]:
    """The fields of the first messages' rows."""
    found: dict[str, None] = {}
    count = 0
    for row in _rows(path, messages, query, None):
        found |= dict.fromkeys(row or ())
        count += row is None
        if count >= _LOOKED_AT:
            break
    return [LOG_TIME, *sorted(name for name in found if name != LOG_TIME)]
