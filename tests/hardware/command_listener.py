"""Writes which commands come, until a while after the process that started it is gone.

`command_listener.py URL FILE`; it says a line when it listens.
"""

import json
import select
import sys
import time
from pathlib import Path

import numpy as np

from poil_drake.systems.lcm_network import LcmNetwork
from poil_drake.systems.panda_lcm_messages import PandaChannels, decode_panda_command

AFTERWARDS = 1.5


def main(url: str, path: Path) -> None:
    told: list[tuple[float, float]] = []

    def hear(message: bytes) -> None:
        told.append((time.time(), float(np.abs(decode_panda_command(message).velocity).max())))

    lcm = LcmNetwork(url)
    lcm.Subscribe(PandaChannels().command, hear)
    print("ready", flush=True)
    end = None
    while end is None or time.monotonic() < end:
        lcm.HandleSubscriptions(10)
        if end is None and select.select([sys.stdin], [], [], 0.0)[0]:
            end = time.monotonic() + AFTERWARDS
    path.write_text(json.dumps(told))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
