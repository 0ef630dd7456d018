"""How much of somebody's log is taken into memory; what claims more is refused."""

from __future__ import annotations

LARGEST_CHUNK = 1 << 28
"""Bytes of a chunk after decompression."""
LARGEST_MESSAGE = 1 << 24
"""Bytes of a message of the topic that is read: an object list of thousands has less than one million."""
MOST_TIMES_SMALLER = 200
"""How many times smaller compression makes a whole log; what expands further is no measurement."""
MOST_ELEMENTS = 200_000
"""Elements of all lists of one message."""
MOST_CELLS = 20_000_000
"""Rows times columns of a table."""
MOST_COLUMNS = 5_000
LONGEST_ARRAY = 9
"""Numbers of an array that become columns of their own: a position, a quaternion, a rotation matrix."""
DEEPEST = 30
"""Levels of structures in a message."""
LARGEST_SCHEMA = 4_000_000
"""Bytes of a message definition."""
