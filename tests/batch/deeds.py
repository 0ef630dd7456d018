"""What tasks do in tests of the workers; a module of its own, as child processes import it anew."""

from __future__ import annotations

import errno
import os
import signal
import time

from resim.core.errors import ResimError


def act(task: tuple[str, int]) -> tuple[int, int]:
    """Give the number and the process, or end as the name says."""
    name, number = task
    if name == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "leave":
        os._exit(7)
    if name == "hang":
        time.sleep(60.0)
    if name == "refuse":
        raise ResimError("the input is wrong")
    if name == "full":
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as e:
            raise ResimError("the cache cannot be written") from e
    if name == "print":
        print("what a function has to say", flush=True)
    if name == "interrupt":
        raise KeyboardInterrupt
    if name == "raise":
        raise ZeroDivisionError("a fault of our own")
    return number, os.getpid()
