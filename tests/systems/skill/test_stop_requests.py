import threading

import pytest
from pydrake.geometry import Meshcat
from system_bench import SystemBench

from poil_drake.systems.skill.stop_requests import BUTTON, StopRequests, StopSwitch

PERIOD = 1 / 256


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
