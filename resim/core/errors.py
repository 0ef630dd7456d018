"""The errors of resim. Each text names the file, the place in it, the value, and what to do."""

from __future__ import annotations

from pathlib import Path


class ResimError(Exception):
    """Anything that stops a job for a reason the user can read. Commands end with exit code 2."""


class InputError(ResimError):
    """A user's file or argument cannot be used.

    ``source`` is the file or argument, ``problem`` says where in it and what is wrong with which value,
    ``remedy`` what to do about it.
    """

    def __init__(self, source: str | Path, problem: str, remedy: str = "") -> None:
        self.source, self.problem, self.remedy = str(source), problem, remedy
        text = f"{source}: {problem.rstrip('.')}"
        super().__init__(f"{text}. {remedy}" if remedy else f"{text}.")


class ConversionError(ResimError):
    """netconvert refused a map or crashed on it."""


class FunctionError(ResimError):
    """The AD function under test raised, answered nonsense or overran its time limit: the run has failed."""
