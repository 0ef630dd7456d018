"""What the machine is doing: cores, memory, disk."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import psutil


@dataclass(frozen=True)
class MachineLoad:
    """cores: how many; busy: share of them over the last second [%], None before that is known; waiting: processes that
    want one, mean over a minute. The rest is in bytes.
    """

    cores: int
    busy: float | None
    waiting: float
    memory: int
    memory_used: int
    disk: int
    disk_used: int
    disk_free: int


def machine_load(folder: Path, busy: float | None) -> MachineLoad:
    """Give it as it is now; disk: that of a folder; busy: as `Changes` saw it last [%]."""
    memory, there = psutil.virtual_memory(), folder
    while not there.exists():
        there = there.parent
    disk = shutil.disk_usage(there)
    return MachineLoad(
        cores=os.cpu_count() or 1, busy=busy, waiting=os.getloadavg()[0], memory=memory.total,
        memory_used=memory.total - memory.available, disk=disk.total, disk_used=disk.used, disk_free=disk.free,
    )  # fmt: skip
