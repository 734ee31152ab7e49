import pytest
from capture_bench import SettableClock

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.stamps import HostStamps


@pytest.fixture
def dut(clock: SettableClock) -> HostStamps:
    return HostStamps(clock, source="It")


@pytest.mark.parametrize(("stamp", "expected"), [(999.875, 499.875), (1000.002, 500.0)])
def test_by_another_clock_an_image_has_the_same_age_but_is_never_in_the_future(
    clock: SettableClock, stamp: float, expected: float
) -> None:
    dut = HostStamps(SettableClock(500.0), source="It")

    # 1000 s - 999.875 s = 0.125 s old; all these are exact in binary.
    assert dut.convert(stamp) == expected


def test_a_stamp_that_is_not_later_is_not_new(dut: HostStamps) -> None:
    stamps = (999.9, 999.9, 999.8, 999.95)

    assert [dut.convert(stamp) for stamp in stamps] == [999.9, None, None, 999.95]


@pytest.mark.parametrize("stamp", [1001.5, float("nan"), float("inf"), float("-inf")])
def test_a_stamp_of_another_clock_is_rejected(dut: HostStamps, stamp: float) -> None:
    with pytest.raises(CaptureError, match="It stamped an image"):
        dut.convert(stamp)


def test_a_clock_that_stays_late_is_rejected_after_30_images(dut: HostStamps) -> None:
    assert [dut.convert(900.0 + k) for k in range(29)] == [None] * 29

    with pytest.raises(CaptureError, match=r"which is 71\.000 s before"):
        dut.convert(929.0)


def test_a_good_stamp_resets_the_count_of_late_ones(dut: HostStamps, clock: SettableClock) -> None:
    for second in range(2):
        start = 1000.0 + 10.0 * second
        clock.now = start + 5.0
        assert [dut.convert(start + 0.1 * k) for k in range(29)] == [None] * 29
        assert dut.convert(start + 4.9) is not None


def test_a_frozen_camera_may_repeat_its_stamp_forever(
    dut: HostStamps, clock: SettableClock
) -> None:
    dut.convert(1000.0)
    clock.now = 1005.0

    assert [dut.convert(1000.0) for _ in range(40)] == [None] * 40


def test_after_a_restart_an_older_stamp_is_accepted(dut: HostStamps) -> None:
    assert [dut.convert(stamp) for stamp in (999.9, 999.8)] == [999.9, None]

    dut.restart()

    assert dut.convert(999.8) == 999.8
