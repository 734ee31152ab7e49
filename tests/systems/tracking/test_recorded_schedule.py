import pytest

from poil_drake.errors import InvalidValueError
from poil_drake.systems.tracking.recorded_schedule import RecordedSchedule
from poil_drake.systems.tracking.release_schedule import Captured

CAPTURES = [0.125, 0.3, 0.55]
RELEASES = [(0.25, 0), (0.7, 2)]


@pytest.fixture
def dut():
    return RecordedSchedule(captures=CAPTURES, releases=RELEASES)


def test_captures_are_counted(dut):
    ticks = [dut.capture_tick(time) for time in (0.0, 0.125, 0.29, 0.3, 9.0)]

    assert ticks == [-1, 0, 0, 1, 2]


def test_what_was_released_last_is_due(dut):
    queue = tuple(Captured(tick, str(tick)) for tick in range(3))

    found = [dut.due(queue, time) for time in (0.2, 0.25, 0.69, 0.7, 9.0)]

    assert [entry and entry.item for entry in found] == [None, "0", "0", "2", "2"]


def test_what_is_still_to_be_released_stays_in_the_queue(dut):
    queue = ()
    for time in CAPTURES:
        queue = dut.added(queue, time, time)

    # The first was released before the last capture, the second never was.
    assert [entry.tick for entry in queue] == [1, 2]
    assert dut.due(dut.added((), 0.125, "first"), 0.25) == (0, "first")


def test_releases_are_told_by_the_time_of_their_capture():
    dut = RecordedSchedule.of(CAPTURES, [(0.25, 0.125), (0.4, 0.2), (0.7, 0.55)])

    # Nothing was captured at 0.2 s, as in a recording that begins late.
    assert dut.releases == ((0.25, 0), (0.7, 2))


@pytest.mark.parametrize(
    ("captures", "releases"),
    [
        ([0.3, 0.1], []),
        ([0.1], [(0.05, 0)]),
        ([0.1], [(0.2, 1)]),
        ([0.1, 0.2], [(0.4, 1), (0.3, 0)]),
    ],
)
def test_what_cannot_have_been_is_refused(captures, releases):
    with pytest.raises(InvalidValueError, match="in order of time"):
        RecordedSchedule(captures=captures, releases=releases)
