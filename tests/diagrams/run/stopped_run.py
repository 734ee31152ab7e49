"""Runs `poil`, and sends itself a signal in the middle of the closed loop.

Arguments: the signal's number, then those of `poil`.
"""

import os
import sys

from pydrake.systems.framework import Context

from poil_drake import cli
from poil_drake.diagrams.run.recorder import RunRecorder

SAMPLES = 10
"""Number of samples before the signal."""


def main() -> None:
    number = int(sys.argv.pop(1))
    take_sample = RunRecorder.sample

    def sample(self: RunRecorder, root: Context) -> None:
        take_sample(self, root)
        if len(self.times) == SAMPLES:
            os.kill(os.getpid(), number)

    RunRecorder.sample = sample
    cli.main()


if __name__ == "__main__":
    main()
