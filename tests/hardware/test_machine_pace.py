import pytest
from machine_pace import ROOM, Pace, first_kept, slower


def test_the_robots_time_passes_more_and_more_slowly_down_to_an_eighth() -> None:
    assert slower(1.0) == [1.0, 0.5, 0.25, 0.125]
    assert slower(1.0, step=0.5**0.5)[::2] == pytest.approx(slower(1.0))
    assert slower(0.7) == [0.7, 0.35, 0.175, 0.125]


def test_the_first_attempt_that_keeps_up_counts() -> None:
    def attempt(scale: float) -> tuple[str, Pace]:
        return f"at {scale}", Pace(held_up=0.018 * scale)

    assert first_kept(slower(1.0), attempt) == "at 1.0"
    assert first_kept(slower(1.0), attempt, worst=ROOM) == "at 0.25"


@pytest.mark.parametrize(
    "pace", [Pace(held_up=0.021), Pace(held_up=0.0, blind=1.1)], ids=["held_up", "blind"]
)
def test_a_machine_that_never_keeps_up_skips_the_test_and_says_why(pace: Pace) -> None:
    with pytest.raises(pytest.skip.Exception) as skipped:
        first_kept(slower(1.0), lambda scale: (None, pace))

    assert f"at a time scale of 0.125 {pace}" in str(skipped.value)
