import socket

import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from poil_drake.errors import StationError
from poil_drake.systems.lcm.network import LcmNetwork, LcmPump

PERIOD = 1 / 256


@pytest.fixture
def url() -> str:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        return f"udpm://239.255.76.67:{taken.getsockname()[1]}?ttl=0"


def receive(dut: LcmNetwork, count: int, got: list[bytes]) -> None:
    """Handles messages until this many have arrived."""
    while len(got) < count:
        dut.HandleSubscriptions(100)


def test_all_messages_between_two_calls_are_handled_in_order(url: str) -> None:
    dut, got = LcmNetwork(url), []
    dut.Subscribe("CHANNEL", got.append)
    sender = LcmNetwork(url)
    # As many as certainly fit into the buffer of a socket.
    sent = [b"%d" % k for k in range(100)]
    for message in sent:
        sender.Publish("OTHER", b"no")
        sender.Publish("CHANNEL", message)

    receive(dut, len(sent), got)

    assert got == sent
    assert dut.HandleSubscriptions(0) == 0  # Without messages it does not wait.


def test_a_closed_network_keeps_no_messages(url: str) -> None:
    dut, got, others = LcmNetwork(url), [], []
    dut.Subscribe("CHANNEL", got.append)
    reference_view = LcmNetwork(url)
    reference_view.Subscribe("CHANNEL", others.append)

    dut.Close()
    dut.Close()
    reference_view.Publish("CHANNEL", b"late")
    receive(reference_view, 1, others)

    assert others == [b"late"]
    assert dut.HandleSubscriptions(50) == 0
    assert got == []


@pytest.mark.parametrize("wrong", ["nonsense://", "udpm://10.0.0.1:7667"])
def test_a_network_that_cannot_be_opened_is_named(wrong: str) -> None:
    with pytest.raises(StationError, match=wrong):
        LcmNetwork(wrong)


class Looker(LeafSystem):
    """Remembers how many messages had come at each of its updates."""

    def __init__(self, got: list[bytes]):
        super().__init__()
        self.got, self.seen = got, []
        self.DeclareAbstractState(Value(0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._look)

    def _look(self, context: Context, state: State) -> None:
        self.seen.append(len(self.got))


def test_the_pump_comes_before_those_that_were_added_later(url: str) -> None:
    network, got = LcmNetwork(url), []
    network.Subscribe("CHANNEL", got.append)
    builder = DiagramBuilder()
    builder.AddSystem(LcmPump(network=network, period=PERIOD))
    looker = builder.AddSystem(Looker(got))
    simulator = Simulator(builder.Build())
    sender = LcmNetwork(url)

    for tick in range(1, 4):
        sender.Publish("CHANNEL", b"again")
        # Until it has arrived, which shows only when LCM handles it.
        while len(got) < tick:
            simulator.AdvanceTo(simulator.get_context().get_time() + PERIOD)

    assert looker.seen[-1] == 3
    assert sorted(looker.seen) == looker.seen
