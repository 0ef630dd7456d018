"""How loops are compiled by numba: what is called from Python is kept on disk, and compiled by one process at a time.

By itself numba compiles a function in every process that finds none on disk: tasks or workers that begin together on a
new machine would each compile the same for a minute. Here the first one does, and the others wait and read it.

Numba takes what is on disk for good as long as the function's own module is unchanged. So a kernel takes nothing from
others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import fcntl
from contextlib import suppress
from pathlib import Path

from numba import njit
from numba.core.caching import FunctionCache

NUMPY = {"error_model": "numpy"}
"""Division by zero gives what the processor gives, as in numpy."""

inner = njit(**NUMPY, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Of what is called from compiled functions alone: it compiles in three quarters of the time. Called from Python it
ends the process."""

inlined = njit(**NUMPY, no_cpython_wrapper=True, no_cfunc_wrapper=True, forceinline=True)
"""The same, for what stands inside of loops: a call there keeps them from becoming vector operations."""

unfolded = njit(**NUMPY, inline="always")
"""Of a long function that is called at one place, and is put there: else all below it is compiled once more with it."""


def entry(*signatures, nogil=False):
    """Give the decorator of a function that is called from Python.

    signatures: tuples of the arguments' types, for which it is compiled at once, which is before any function's time
    limit runs, and for no others; without any it is compiled for those that it is called with. nogil: whether other
    threads go on meanwhile.
    """

    def compiled(function):
        kernel = njit(**NUMPY, nogil=nogil)(function)
        with suppress(RuntimeError):  # where no folder can be written, each process compiles for itself
            kernel._cache = _SharedCache(function)
            kernel.compile = kernel._cache.releasing(kernel.compile)
        for signature in signatures:
            kernel.compile(signature)
        if signatures:
            kernel.disable_compile()
        return kernel

    return compiled


class _SharedCache(FunctionCache):
    """What numba keeps of a function on disk, behind a lock of a file beside it, which is gone with its process."""

    _lock = None

    def load_overload(self, sig, target_context):
        found = super().load_overload(sig, target_context)
        if found is None:
            self._impl.locator.ensure_cache_path()
            self._lock = Path(self.cache_path, f"{self._impl.filename_base}.lock").open("w")  # noqa: SIM115
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            found = super().load_overload(sig, target_context)  # somebody else compiled it meanwhile
        return found

    def releasing(self, compiling):
        """Give the same function, after which others may compile, however it ended."""

        def compiled(signature):
            try:
                return compiling(signature)
            finally:
                self._release()

        return compiled

    def _release(self):
        if self._lock is not None:
            fcntl.flock(self._lock, fcntl.LOCK_UN)  # for children, too, that were forked with the file
            self._lock.close()
            self._lock = None
