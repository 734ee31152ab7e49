import io
import os
import pty
import termios
import threading
from collections.abc import Iterator

import pytest

from poil_drake.systems.skill.stop_requests import StopSwitch
from poil_drake.systems.skill.terminal_stop_key import terminal_stop_key

PATIENCE = 3600.0  # [s]; only a failing test waits that long.


class Noticing(StopSwitch):
    """Lets a test wait for a request."""

    def __init__(self) -> None:
        super().__init__()
        self.pressed = threading.Semaphore(0)

    def request(self) -> None:
        super().request()
        self.pressed.release()


@pytest.fixture
def keyboard() -> Iterator[tuple[int, io.TextIOWrapper]]:
    """The end that receives typed keys, and the terminal."""
    typing, terminal = pty.openpty()
    with os.fdopen(terminal, "r") as stream:
        yield typing, stream
    os.close(typing)


@pytest.mark.parametrize("key", [b" ", b"\r", b"\n", b"q", b"Q", b"\x1b"])
def test_a_stop_key_requests_a_stop(keyboard, key: bytes) -> None:
    typing, terminal = keyboard
    switch = Noticing()

    with terminal_stop_key(switch, stream=terminal) as active:
        os.write(typing, key)
        noticed = switch.pressed.acquire(timeout=PATIENCE)

        assert active
    assert noticed
    assert switch.requests == 1


def test_other_keys_do_nothing(keyboard) -> None:
    typing, terminal = keyboard
    switch = Noticing()

    with terminal_stop_key(switch, stream=terminal):
        # Keys are read in order: once the space was read, so were those before it.
        os.write(typing, b"abc1/-")
        os.write(typing, b" ")
        assert switch.pressed.acquire(timeout=PATIENCE)

    assert switch.requests == 1


def test_every_key_press_counts(keyboard) -> None:
    typing, terminal = keyboard
    switch = Noticing()

    with terminal_stop_key(switch, stream=terminal):
        os.write(typing, b"q q")
        for _ in range(3):
            assert switch.pressed.acquire(timeout=PATIENCE)

    assert switch.requests == 3


def test_keys_arrive_without_enter_and_the_terminal_is_given_back(keyboard) -> None:
    _, terminal = keyboard
    before = termios.tcgetattr(terminal)

    with terminal_stop_key(StopSwitch(), stream=terminal):
        local_modes = termios.tcgetattr(terminal)[3]

    assert not local_modes & (termios.ICANON | termios.ECHO)
    assert local_modes & termios.ISIG  # Ctrl-C still interrupts.
    assert before[3] & termios.ICANON
    assert termios.tcgetattr(terminal) == before


def test_the_terminal_is_given_back_after_an_error(keyboard) -> None:
    _, terminal = keyboard
    before = termios.tcgetattr(terminal)

    with (
        pytest.raises(KeyboardInterrupt),
        terminal_stop_key(StopSwitch(), stream=terminal),
    ):
        raise KeyboardInterrupt

    assert termios.tcgetattr(terminal) == before


def test_afterwards_keys_have_no_effect(keyboard) -> None:
    typing, terminal = keyboard
    switch = Noticing()

    with terminal_stop_key(switch, stream=terminal):
        pass
    os.write(typing, b" \n")

    assert os.read(terminal.fileno(), 2) == b" \n"  # It is still there for others.
    assert switch.requests == 0


def test_a_terminal_that_goes_away_is_a_stop_and_no_error(keyboard) -> None:
    typing, terminal = keyboard
    switch = Noticing()

    with terminal_stop_key(switch, stream=terminal), open(os.devnull) as elsewhere:
        os.dup2(elsewhere.fileno(), typing)
        assert switch.pressed.acquire(timeout=PATIENCE)

    assert switch.requests == 1


def test_a_file_is_left_alone(tmp_path) -> None:
    file = tmp_path / "keys"
    file.write_text(" q\n")
    switch = StopSwitch()

    with file.open() as stream, terminal_stop_key(switch, stream=stream) as active:
        assert not active
        assert stream.read() == " q\n"

    assert switch.requests == 0


@pytest.mark.parametrize("closed", [False, True])
def test_a_stream_without_a_file_is_left_alone(closed: bool) -> None:
    stream = io.StringIO(" ")
    if closed:
        stream.close()

    with terminal_stop_key(StopSwitch(), stream=stream) as active:
        assert not active
