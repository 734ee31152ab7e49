"""A system under test on an in-memory LCM network, and addresses of networks on this machine."""

import socket
from collections.abc import Callable
from typing import Any

from pydrake.lcm import DrakeLcm
from pydrake.systems.framework import System
from system_bench import SystemBench


def free_url() -> str:
    """Returns the address of an LCM network that no other process uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        return f"udpm://239.255.76.67:{taken.getsockname()[1]}?ttl=0"


class NetworkBench(SystemBench):
    """Simulates a system made with `lcm` and `clock`; the test is the other end of the network.

    Attributes:
        lcm: The network.
    """

    def __init__(self, make: Callable[..., System], **inputs: Any):
        self.lcm = DrakeLcm("memq://test")
        super().__init__(make(lcm=self.lcm, clock=self.now), **inputs)

    def publish(self, channel: str, message: bytes) -> None:
        self.lcm.Publish(channel, message)
        self.lcm.HandleSubscriptions(0)

    def hear(self, channel: str, decode: Callable[[bytes], Any] = bytes) -> list[Any]:
        """Returns a list to which each message on a channel is appended."""
        heard: list[Any] = []
        self.lcm.Subscribe(channel, lambda message: heard.append(decode(message)))
        return heard

    def advance_to(self, time: float) -> None:
        super().advance_to(time)
        self.lcm.HandleSubscriptions(0)
