import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

import pytest

from poil_drake.reports.progress import OneLineTqdm, ProgressBar, StatusLine

_SHOW = """
from poil_drake.reports.progress import ProgressBar
with ProgressBar() as progress:
    progress("planning", 0.5)
    progress("closed loop", 1.0)
"""


def test_each_step_has_a_bar(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressBar() as dut:
        dut("planning", 0.0)
        dut("planning", 0.25)
        dut("closed loop", 1.0)

    planning, closed_loop = capsys.readouterr().err.splitlines()[1::2]
    assert planning.startswith("planning")
    assert " 25% |" in planning
    assert closed_loop.startswith("closed loop")
    assert "100% |" in closed_loop


def test_a_status_line_goes_only_to_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with StatusLine() as dut:
        dut("left 30/s")
        dut.say("a camera stopped")
    assert capsys.readouterr() == ("a camera stopped\n", "")

    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with StatusLine() as dut:
        dut("left 30/s")
        dut("left 29/s")
        dut.say("a camera stopped")
    out, err = capsys.readouterr()
    assert out == "a camera stopped\n"
    assert err.index("left 30/s") < err.index("left 29/s")
    assert err.split("\r")[-1].strip() == ""  # Nothing is left on the terminal.


def test_only_one_line_goes_to_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    with OneLineTqdm(total=3, desc="trials", mininterval=0.0) as dut:
        for trial in range(3):
            OneLineTqdm.write(f"trial {trial}")
            dut.update()

    said = capsys.readouterr()
    assert said.out.split("\n") == ["trial 0", "trial 1", "trial 2", ""]
    assert said.err.count("\n") == 1
    assert said.err.count("trials: 100%") == 1


def shown_on_terminal(columns: int, lines: int, *, stdout: int | None = None) -> str:
    """Returns the output of two bars to a terminal of some size on standard error."""
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


def test_bars_are_readable_on_a_terminal_that_reports_no_columns() -> None:
    shown = shown_on_terminal(0, 0)

    assert "planning" in shown
    assert "closed loop" in shown


def test_bars_are_no_wider_than_their_terminal() -> None:
    shown = shown_on_terminal(50, 24, stdout=subprocess.DEVNULL)

    assert "planning" in shown
    assert max(len(bar) for bar in shown.replace("\n", "\r").split("\r")) <= 50
