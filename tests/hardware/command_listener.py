"""Records the commands to the arm until a while after its parent process has ended.

`command_listener.py URL FILE TIME_SCALE`; it prints a line once it listens.
"""

import math
import select
import sys
import time
from pathlib import Path

import numpy as np

from poil_drake.recording.mcap.plain_json import write_json
from poil_drake.systems.lcm.network import LcmNetwork
from poil_drake.systems.lcm.panda_messages import PandaChannels, decode_panda_command

AFTERWARDS = 1.5  # [s of the robot's time]


def main(url: str, path: Path, time_scale: float) -> None:
    commands: list[tuple[float, float]] = []

    def now() -> float:
        return time_scale * time.time()

    def record(message: bytes) -> None:
        commands.append((now(), float(np.abs(decode_panda_command(message).velocity).max())))

    lcm = LcmNetwork(url)
    lcm.Subscribe(PandaChannels().command, record)
    print("ready", flush=True)
    end = math.inf
    try:
        while now() < end:
            lcm.HandleSubscriptions(10)
            if end == math.inf and select.select([sys.stdin], [], [], 0.0)[0]:
                end = now() + AFTERWARDS
    finally:
        write_json(commands, path, indent=None)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]))
