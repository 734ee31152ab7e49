import pytest
from capture_bench import SettableClock

from poil_drake.errors import CaptureError
from poil_drake.perception.capture.host_stamps import HostStamps


def test_by_the_same_clock_a_stamp_stays_as_it_is() -> None:
    clock = SettableClock(1000.0)

    assert HostStamps(clock, source="It", host_clock=clock).convert(999.97) == 999.97


def test_by_another_clock_an_image_is_as_old_as_by_the_computers() -> None:
    dut = HostStamps(SettableClock(500.0), source="It", host_clock=SettableClock(1000.0))

    # 1000 s - 999.875 s = 0.125 s old; all these are exact in binary.
    assert dut.convert(999.875) == 499.875


def test_a_stamp_a_little_ahead_counts_as_now() -> None:
    dut = HostStamps(SettableClock(500.0), source="It", host_clock=SettableClock(1000.0))

    assert dut.convert(1000.002) == 500.0


def test_what_is_no_later_is_not_new() -> None:
    dut = HostStamps(SettableClock(500.0), source="It", host_clock=SettableClock(1000.0))
    dut.convert(999.9)

    assert dut.convert(999.9) is None
    assert dut.convert(999.8) is None
    assert dut.convert(999.95) is not None


@pytest.mark.parametrize("stamp", [1001.5, float("nan"), float("inf"), float("-inf")])
def test_a_stamp_of_another_clock_is_refused(stamp: float) -> None:
    clock = SettableClock(1000.0)

    with pytest.raises(CaptureError, match="It stamps an image"):
        HostStamps(clock, source="It", host_clock=clock).convert(stamp)


def test_an_image_that_is_too_old_is_left_out_and_the_next_one_taken() -> None:
    clock = SettableClock(1000.0)
    dut = HostStamps(clock, source="It", host_clock=clock)

    assert dut.convert(998.5) is None
    assert dut.convert(999.5) == 999.5


def test_a_clock_that_stays_late_is_refused_in_the_end() -> None:
    clock = SettableClock(1000.0)
    dut = HostStamps(clock, source="It", host_clock=clock)
    for k in range(29):
        assert dut.convert(900.0 + k) is None

    with pytest.raises(CaptureError, match=r"which is 71\.000 s before"):
        dut.convert(929.0)


def test_a_good_stamp_forgives_late_ones() -> None:
    clock = SettableClock(1000.0)
    dut = HostStamps(clock, source="It", host_clock=clock)
    for second in range(2):
        start = 1000.0 + 10.0 * second
        clock.now = start + 5.0
        assert [dut.convert(start + 0.1 * k) for k in range(29)] == [None] * 29
        assert dut.convert(start + 4.9) is not None


def test_a_frozen_camera_repeats_its_stamp_for_ever() -> None:
    clock = SettableClock(1000.0)
    dut = HostStamps(clock, source="It", host_clock=clock)
    dut.convert(1000.0)
    clock.now = 1005.0

    assert [dut.convert(1000.0) for _ in range(40)] == [None] * 40


def test_after_a_restart_an_older_stamp_is_taken() -> None:
    clock = SettableClock()
    dut = HostStamps(clock, source="it", host_clock=clock)
    assert dut.convert(clock() - 0.1) is not None
    assert dut.convert(clock() - 0.2) is None

    dut.restart()

    assert dut.convert(clock() - 0.2) is not None
