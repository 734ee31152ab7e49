import io
import os
import pty
import termios
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from poil_drake.systems.skill.stop_requests import StopSwitch
from poil_drake.systems.skill.terminal_stop_key import terminal_stop_key

PATIENCE = 3600.0  # [s]; only a failing test waits that long.


class CountingSwitch(StopSwitch):
    """Lets a test wait for a request."""

    def __init__(self) -> None:
        super().__init__()
        self.pressed = threading.Semaphore(0)

    def request(self) -> None:
        super().request()
        self.pressed.release()


@pytest.fixture
def keyboard() -> Iterator[tuple[int, io.TextIOWrapper]]:
    """The descriptor that types, and the terminal."""
    typing, terminal = pty.openpty()
    with os.fdopen(terminal, "r") as stream:
        yield typing, stream
    os.close(typing)


@pytest.mark.parametrize(
    ("typed", "requests"),
    [
        *((key, 1) for key in (b" ", b"\r", b"\n", b"q", b"Q", b"\x1b")),
        (b"q q", 3),
        (b"abc1/- ", 1),  # Keys are read in order, so the others are read before the space.
    ],
)
def test_each_stop_key_requests_a_stop(keyboard, typed: bytes, requests: int) -> None:
    typing, terminal = keyboard
    switch = CountingSwitch()

    with terminal_stop_key(switch, stream=terminal) as active:
        assert active
        os.write(typing, typed)
        for _ in range(requests):
            assert switch.pressed.acquire(timeout=PATIENCE)

    assert switch.requests == requests


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
def test_keys_arrive_without_enter_and_the_terminal_is_restored(
    keyboard, error: type[BaseException] | None
) -> None:
    _, terminal = keyboard
    before = termios.tcgetattr(terminal)

    with suppress(KeyboardInterrupt), terminal_stop_key(StopSwitch(), stream=terminal):
        local_modes = termios.tcgetattr(terminal)[3]
        if error is not None:
            raise error

    assert not local_modes & (termios.ICANON | termios.ECHO)
    assert local_modes & termios.ISIG  # Ctrl-C still interrupts.
    assert before[3] & termios.ICANON
    assert termios.tcgetattr(terminal) == before


def test_afterwards_keys_have_no_effect(keyboard) -> None:
    typing, terminal = keyboard
    switch = CountingSwitch()

    with terminal_stop_key(switch, stream=terminal):
        pass
    os.write(typing, b" \n")

    assert os.read(terminal.fileno(), 2) == b" \n"  # Other programs can still read them.
    assert switch.requests == 0


def test_a_terminal_that_is_closed_is_a_stop_and_no_error(keyboard) -> None:
    typing, terminal = keyboard
    switch = CountingSwitch()

    with terminal_stop_key(switch, stream=terminal), open(os.devnull) as elsewhere:
        os.dup2(elsewhere.fileno(), typing)
        assert switch.pressed.acquire(timeout=PATIENCE)

    assert switch.requests == 1


def test_a_file_is_not_read(tmp_path) -> None:
    file = tmp_path / "keys"
    file.write_text(" q\n")
    switch = StopSwitch()

    with file.open() as stream, terminal_stop_key(switch, stream=stream) as active:
        assert not active
        assert stream.read() == " q\n"

    assert switch.requests == 0


@pytest.mark.parametrize("closed", [False, True])
def test_a_stream_without_a_file_is_not_read(closed: bool) -> None:
    stream = io.StringIO(" ")
    if closed:
        stream.close()

    with terminal_stop_key(StopSwitch(), stream=stream) as active:
        assert not active
