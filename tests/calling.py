"""The command line, called in the process of the tests."""

from __future__ import annotations

import sys

import pytest

from resim import cli


def called(*arguments: object) -> int:
    """Call `resim` in this process; gives its exit code."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(sys, "argv", ["resim", *map(str, arguments)])
        try:
            cli.main()
        except SystemExit as e:
            return int(e.code or 0)
    return 0
