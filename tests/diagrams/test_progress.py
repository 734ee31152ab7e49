import os
import pty
import subprocess
import sys

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


def test_bars_can_be_read_on_a_terminal_that_says_it_has_no_columns() -> None:
    terminal, end = pty.openpty()  # 0 columns and 0 rows
    try:
        subprocess.run(
            [sys.executable, "-P", "-c", _SHOW],
            stdin=end,
            stdout=end,
            stderr=end,
            env={name: value for name, value in os.environ.items() if name != "COLUMNS"},
            check=True,
        )
        shown = os.read(terminal, 100_000).decode()
    finally:
        os.close(end)
        os.close(terminal)

    assert "planning" in shown
    assert "closed loop" in shown
