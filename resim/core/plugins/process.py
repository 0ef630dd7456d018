"""What is everybody's in a process and any code can set: how numpy, Python and the system behave for what follows."""

from __future__ import annotations

import decimal
import gc
import locale
import multiprocessing
import os
import resource
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from resim.core.errors import FunctionError

ProcessState = Mapping[str, Any]
"""What is set, by the names of `_SETTINGS`."""


def state() -> ProcessState:
    """Give what is set now."""
    return {name: get() for name, (get, _) in _SETTINGS.items()}


def put_back(before: ProcessState) -> dict[str, Any]:
    """Set what is otherwise now, and give what that was."""
    now = state()
    found = {name: now[name] for name in before if now[name] != before[name]}
    for name in found:
        _SETTINGS[name][1](before[name])
    return found


LIMITING = ("resource.setrlimit", "resource.prlimit")
"""Audit events of who sets a limit of what a process may use."""


def refuse_lower_limits(*arguments: Any) -> None:
    """Raise FunctionError where a limit of this process would get lower: resim, which works in it, would fail.

    arguments: of the event: the limit, and its soft and hard value; before them the number of the process, if told.
    """
    *process, which, limits = arguments
    if limits is None or which == resource.RLIMIT_CORE or process not in ([], [0], [os.getpid()]):
        return
    for now, new in zip(resource.getrlimit(which), limits, strict=True):
        if new != resource.RLIM_INFINITY and (now == resource.RLIM_INFINITY or new < now):
            names = [name for name in dir(resource) if name.startswith("RLIMIT_")]
            name = next(name for name in names if getattr(resource, name) == which)
            raise FunctionError(f"lowers {name} of its process to {new}; set limits in a process of its own")


def _umask() -> int:
    os.umask(mask := os.umask(0o077))
    return mask


def _handlers() -> dict[int, Any]:
    """The handlers of signals that Python code can set; only the main thread may."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    found = {number: signal.getsignal(number) for number in signal.valid_signals()}
    return {number: handler for number, handler in found.items() if handler is not None}


def _handle(handlers: Mapping[int, Any]) -> None:
    for number, handler in handlers.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


def _set_collector(callbacks: list[Any]) -> None:
    gc.callbacks[:] = callbacks


def _set_environment(values: Mapping[str, str]) -> None:
    for name in os.environ.keys() - values.keys():
        del os.environ[name]
    os.environ.update(values)


def _set_warnings(values: tuple[Any, ...]) -> None:
    filters, warnings.showwarning = values
    warnings.resetwarnings()
    warnings.filters.extend(filters)  # type: ignore[attr-defined]


_SETTINGS: Mapping[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "numpy's errors": (np.geterr, lambda errors: np.seterr(**errors)),
    "umask": (_umask, os.umask),
    "locale": (
        lambda: locale.setlocale(locale.LC_ALL),
        lambda name: locale.setlocale(locale.LC_ALL, name),
    ),
    "signals": (_handlers, _handle),
    "collector": (lambda: [*gc.callbacks], _set_collector),
    "recursion": (sys.getrecursionlimit, sys.setrecursionlimit),
    "warnings": (lambda: ([*warnings.filters], warnings.showwarning), _set_warnings),
    "environment": (lambda: dict(os.environ), _set_environment),
    "start of processes": (
        lambda: multiprocessing.get_start_method(allow_none=True),
        lambda method: multiprocessing.set_start_method(method, force=True),
    ),
    "decimals": (
        lambda: decimal.getcontext().prec,
        lambda digits: setattr(decimal.getcontext(), "prec", digits),
    ),
}
