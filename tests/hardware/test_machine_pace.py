"""The choice of the time scale."""

import pytest
from machine_pace import ROOM, Pace, first_that_keeps_up, slower_scales


def test_time_scales_decrease_to_an_eighth() -> None:
    assert slower_scales(1.0) == [1.0, 0.5, 0.25, 0.125]
    assert slower_scales(1.0, step=0.5**0.5)[::2] == pytest.approx(slower_scales(1.0))
    assert slower_scales(0.7) == [0.7, 0.35, 0.175, 0.125]


def test_the_first_attempt_that_keeps_up_counts() -> None:
    def attempt(scale: float) -> tuple[str, Pace]:
        return f"at {scale}", Pace(lag=0.018 * scale)

    assert first_that_keeps_up(slower_scales(1.0), attempt) == "at 1.0"
    assert first_that_keeps_up(slower_scales(1.0), attempt, worst=ROOM) == "at 0.25"


@pytest.mark.parametrize(
    "pace", [Pace(lag=0.021), Pace(lag=0.0, first_track=1.1)], ids=["lag", "first_track"]
)
def test_a_machine_that_never_keeps_up_skips_the_test_with_the_reason(pace: Pace) -> None:
    with pytest.raises(pytest.skip.Exception) as skipped:
        first_that_keeps_up(slower_scales(1.0), lambda scale: (None, pace))

    assert f"at a time scale of 0.125 {pace}" in str(skipped.value)
