import pytest
from network_bench import free_url
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from poil_drake.errors import StationError
from poil_drake.systems.lcm.network import LcmNetwork, LcmPump

PERIOD = 1 / 256


@pytest.fixture
def url() -> str:
    return free_url()


def receive(dut: LcmNetwork, count: int, got: list[bytes]) -> None:
    """Handles messages until this many have arrived."""
    while len(got) < count:
        dut.HandleSubscriptions(100)


def test_all_messages_between_two_calls_are_handled_in_order(url: str) -> None:
    dut, got = LcmNetwork(url), []
    dut.Subscribe("CHANNEL", got.append)
    sender = LcmNetwork(url)
    # As many as fit into the buffer of a socket.
    sent = [b"%d" % k for k in range(100)]
    for message in sent:
        sender.Publish("OTHER", b"no")
        sender.Publish("CHANNEL", message)

    receive(dut, len(sent), got)

    assert got == sent
    assert dut.HandleSubscriptions(0) == 0  # It does not wait for messages.


def test_a_closed_network_keeps_no_messages(url: str) -> None:
    dut, got, heard_by_other = LcmNetwork(url), [], []
    dut.Subscribe("CHANNEL", got.append)
    other = LcmNetwork(url)
    other.Subscribe("CHANNEL", heard_by_other.append)

    dut.Close()
    dut.Close()
    other.Publish("CHANNEL", b"late")
    receive(other, 1, heard_by_other)

    assert heard_by_other == [b"late"]
    assert dut.HandleSubscriptions(50) == 0
    assert got == []


@pytest.mark.parametrize("wrong", ["nonsense://", "udpm://10.0.0.1:7667"])
def test_a_network_that_cannot_be_opened_is_named(wrong: str) -> None:
    with pytest.raises(StationError, match=wrong):
        LcmNetwork(wrong)


class Counter(LeafSystem):
    """Records how many messages had arrived at each of its updates."""

    def __init__(self, got: list[bytes]):
        super().__init__()
        self.got, self.counts = got, []
        self.DeclareAbstractState(Value(0))
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._count)

    def _count(self, context: Context, state: State) -> None:
        self.counts.append(len(self.got))


def test_the_pump_updates_before_systems_that_were_added_later(url: str) -> None:
    network, got = LcmNetwork(url), []
    network.Subscribe("CHANNEL", got.append)
    builder = DiagramBuilder()
    builder.AddSystem(LcmPump(network=network, period=PERIOD))
    counter = builder.AddSystem(Counter(got))
    simulator = Simulator(builder.Build())
    sender = LcmNetwork(url)

    for tick in range(1, 4):
        sender.Publish("CHANNEL", b"again")
        # Until it has arrived, which LCM shows only by handling it.
        while len(got) < tick:
            simulator.AdvanceTo(simulator.get_context().get_time() + PERIOD)

    assert counter.counts[-1] == 3
    assert sorted(counter.counts) == counter.counts
