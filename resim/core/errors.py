"""The errors of resim. Each text names the file, the place in it, the value, and what to do."""

from __future__ import annotations

from pathlib import Path

MOST_CHARACTERS = 1500


class ResimError(Exception):
    """Anything that stops a job for a reason the user can read. Commands end with exit code 2.

    The text is one line: what would break it or steer a terminal is escaped, a very long one loses its middle.
    """

    def __init__(self, text: str) -> None:
        super().__init__(_one_line(text))


class InputError(ResimError):
    """A user's file or argument cannot be used.

    ``source`` is the file or argument, ``problem`` says where in it and what is wrong with which value,
    ``remedy`` what to do about it.
    """

    def __init__(self, source: str | Path, problem: str, remedy: str = "") -> None:
        self.source, self.problem, self.remedy = str(source), problem, remedy
        text = f"{source}: {problem.rstrip('.')}" + "." * (not problem.endswith("?"))
        super().__init__(f"{text} {remedy}" if remedy else text)


class ConversionError(ResimError):
    """netconvert refused a map or crashed on it."""


class FunctionError(ResimError):
    """The AD function under test raised, answered nonsense or overran its time limit: the run has failed.

    frames: where it raised, from its own code on: file, line, name of what is called there; the innermost last.
    words: the end of what it, or a process of its own, had written to the standard error during the call.
    """

    def __init__(self, text: str, frames: tuple[tuple[str, int, str], ...] = (), words: str = "") -> None:
        super().__init__(text)
        self.frames = frames
        self.words = words


class ChangedError(FunctionError):
    """Code under test changed the program that judges it: nothing that this process says of it can be believed."""


class StopError(SystemExit):
    """A signal ends the program; no code under test did."""


def _one_line(text: str) -> str:
    if not text.isprintable():
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    half = MOST_CHARACTERS // 2
    return text if len(text) <= MOST_CHARACTERS else f"{text[:half]} ... {text[-half:]}"
