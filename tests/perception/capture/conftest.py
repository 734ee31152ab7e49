import pytest
from capture_bench import SettableClock

from poil_drake.perception.capture import stamps


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SettableClock:
    """Our clock, which is also the computer's."""
    clock = SettableClock(1000.0)
    monkeypatch.setattr(stamps, "_host_clock", clock)
    return clock
