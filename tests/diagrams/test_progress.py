import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest

from poil_drake.diagrams.progress import ProgressBar

_SHOW = """
from poil_drake.diagrams.progress import ProgressBar
with ProgressBar() as progress:
    progress("planning", 0.5)
    progress("closed loop", 1.0)
"""


def test_each_thing_that_is_done_has_a_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar() as dut:
        dut("planning", 0.0)
        dut("planning", 0.25)
        dut("closed loop", 1.0)

    bars = capsys.readouterr().err.replace("\n", "\r").split("\r")
    assert any(bar.startswith("planning") and " 25% |" in bar for bar in bars)
    assert any(bar.startswith("closed loop") and "100% |" in bar for bar in bars)


def shown_on_terminal(columns: int, lines: int, *, stdout: int | None = None) -> str:
    """What a terminal of a size gets to see of two bars on its standard error."""
    terminal, end = pty.openpty()
    fcntl.ioctl(end, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
    try:
        subprocess.run(
            [sys.executable, "-P", "-c", _SHOW],
            stdin=end,
            stdout=stdout,
            stderr=end,
            env={name: value for name, value in os.environ.items() if name != "COLUMNS"},
            check=True,
        )
        return os.read(terminal, 100_000).decode()
    finally:
        os.close(end)
        os.close(terminal)


def test_bars_can_be_read_on_a_terminal_that_says_it_has_no_columns() -> None:
    shown = shown_on_terminal(0, 0)

    assert "planning" in shown
    assert "closed loop" in shown


def test_bars_are_no_wider_than_the_terminal_that_they_are_on() -> None:
    shown = shown_on_terminal(50, 24, stdout=subprocess.DEVNULL)

    assert "planning" in shown
    assert max(len(bar) for bar in shown.replace("\n", "\r").split("\r")) <= 50
