import numpy as np
import pytest

from poil_drake.benchmarks.latency.hardware import summarize


def test_periods_and_jitter_are_in_milliseconds() -> None:
    even = np.arange(1001) * 0.004
    uneven = even.copy()
    uneven[1:] += 0.001  # One period is 5 ms.

    bare, commands = summarize({"bare loop": even + 1e-6 * np.arange(1001), "run": uneven}, 0.004)

    assert bare.p50 == pytest.approx(4.001)
    assert bare.ratio == 1.0
    assert bare.jitter_p99_9 == pytest.approx(0.001)
    assert commands.p50 == pytest.approx(4.0)
    assert commands.largest == pytest.approx(5.0)
    assert commands.ratio == pytest.approx(commands.jitter_p99_9 / 0.001)
