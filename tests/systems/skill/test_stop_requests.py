import io
import os
import pty
import termios
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
from pydrake.geometry import Meshcat
from system_bench import SystemBench

from poil_drake.systems.skill.stop_requests import (
    BUTTON,
    StopRequests,
    StopSwitch,
    terminal_stop_key,
)

PERIOD = 1 / 256
PATIENCE = 3600.0  # [s]; only a failing test waits that long.


def click(meshcat: Meshcat) -> None:
    """Sends the page's message for a pressed button, a MessagePack map of two strings."""
    meshcat._InjectWebsocketMessage(
        message=b"\x82\xa4type\xa6button\xa4name" + bytes([0xA0 + len(BUTTON)]) + BUTTON.encode()
    )


def shown(bench: SystemBench, time: float) -> float:
    bench.advance_to(time)
    bench.simulator.AdvancePendingEvents()
    return bench.read("stop")[0]


@pytest.fixture(scope="module")
def page() -> Meshcat:
    return Meshcat()


def test_requests_at_the_switch_are_counted_from_the_first_update_on() -> None:
    switch = StopSwitch()
    switch.request()
    bench = SystemBench(StopRequests(period=PERIOD, switch=switch))
    assert bench.read("stop")[0] == 0.0

    first = shown(bench, 0.0)
    for _ in range(2):
        switch.request()
    second = shown(bench, PERIOD)

    assert (first, second) == (1.0, 3.0)


def test_clicks_and_requests_add_up(page: Meshcat) -> None:
    switch = StopSwitch()
    bench = SystemBench(StopRequests(period=PERIOD, meshcat=page, switch=switch))

    before = shown(bench, 0.0)
    click(page)
    switch.request()
    after = shown(bench, PERIOD)
    bench.dut.close()

    assert (before, after) == (0.0, 2.0)


def test_the_button_goes_when_closed_and_its_clicks_stay(page: Meshcat) -> None:
    bench = SystemBench(StopRequests(period=PERIOD, meshcat=page))
    assert BUTTON in page.GetButtonNames()
    click(page)

    bench.dut.close()
    bench.dut.close()  # Closing twice is no error.

    assert BUTTON not in page.GetButtonNames()
    assert shown(bench, PERIOD) == 1.0


def test_a_switch_may_be_pressed_from_many_threads() -> None:
    switch = StopSwitch()
    threads = [
        threading.Thread(target=lambda: [switch.request() for _ in range(1000)]) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert switch.requests == 4000


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
