"""The figures of the tracking benchmark, from tracks whose figures follow by hand."""

import math

import numpy as np
import pytest

from poil_drake.benchmarks.tracking.measures import (
    Track,
    false_alarms,
    notice_times,
    recovery_time,
    summarize,
)


def make_track(
    errors: list[float],
    *,
    lost: list[int] | None = None,
    confidence: list[float] | None = None,
    visible: list[float] | None = None,
    disturbance: tuple[float, float] | None = None,
) -> Track:
    """A track of one point at 8 frames per second; errors in millimetres."""
    count = len(errors)
    return Track(
        times=np.arange(count) / 8,
        errors=np.array(errors)[:, None] / 1e3,
        lost=np.isin(np.arange(count), lost or []),
        confidence=np.array(confidence if confidence is not None else [1.0] * count),
        visible=np.array(visible if visible is not None else [1.0] * count),
        wall=np.full(count, 0.05),
        disturbance=disturbance,
    )


NAN = math.nan


def test_a_wrong_track_that_is_given_up_is_noticed_then() -> None:
    dut = make_track([1, 40, 50, NAN, NAN], lost=[3, 4])

    assert notice_times(dut) == ([], [pytest.approx(0.25)])


def test_a_wrong_track_that_becomes_right_is_noticed_then() -> None:
    dut = make_track([1, 40, 1, 1])

    assert notice_times(dut) == ([], [pytest.approx(0.125)])


def test_a_track_that_stays_wrong_is_never_noticed() -> None:
    dut = make_track([1, 40, 50, 60, 70])

    assert notice_times(dut) == ([], [math.inf])


def test_a_hidden_object_is_noticed_when_the_tracker_says_so() -> None:
    dut = make_track([1, 1, 1, NAN, 1], lost=[3], visible=[1, 0, 0, 0, 1])

    assert notice_times(dut) == ([pytest.approx(0.25)], [])


def test_a_hidden_object_is_noticed_when_the_tracker_doubts_every_point() -> None:
    dut = make_track([1, 1, 1, 1], confidence=[1, 0.3, 0.2, 1], visible=[1, 0, 0, 1])

    assert notice_times(dut) == ([pytest.approx(0.125)], [])


def test_a_hidden_object_need_not_be_noticed_at_once() -> None:
    short = make_track([1, 1, 1, 1], visible=[1, 0, 0, 1])
    long = make_track([1] * 6, visible=[1, 0, 0, 0, 0, 1])

    assert notice_times(short) == ([], [])
    assert notice_times(long) == ([math.inf], [])


def test_recovery_is_counted_from_the_end_of_the_disturbance() -> None:
    dut = make_track([1, NAN, NAN, 15, 9, 1], lost=[1, 2], disturbance=(0.1, 0.25))

    assert recovery_time(dut) == pytest.approx(0.25)


def test_an_object_that_is_not_found_again_takes_for_ever() -> None:
    dut = make_track([1, NAN, NAN, NAN], lost=[1, 2, 3], disturbance=(0.1, 0.2))

    assert recovery_time(dut) == math.inf
    assert math.isnan(recovery_time(make_track([1, 1])))


def test_only_a_loss_of_a_visible_undisturbed_object_is_a_false_alarm() -> None:
    visible = [1.0, 1.0, 0.1, 1.0]

    assert false_alarms(make_track([1, NAN, NAN, 1], lost=[1, 2], visible=visible)) == (1, 3)
    assert false_alarms(make_track([1, 1, NAN, NAN], lost=[2, 3], visible=visible)) == (0, 3)
    # The disturbance from 0.1 to 0.2 s, and a second to recover from it, cover all but frame 0.
    disturbed = make_track([1, NAN, 1, 1], lost=[1], disturbance=(0.1, 0.2))
    assert false_alarms(disturbed) == (0, 1)


def test_a_summary_pools_the_trials() -> None:
    good = make_track([1, 2, 3], disturbance=(0.0, 0.0))
    bad = make_track([4, NAN, NAN], lost=[1, 2], disturbance=(0.1, 0.1))

    dut = summarize([good, bad])

    # The reported errors are 1, 2, 3 and 4 mm.
    assert dut["error_median"] == pytest.approx(0.003)
    assert dut["error_p95"] == pytest.approx(0.004)
    assert (dut["trials"], dut["frames"]) == (2, 6)
    assert dut["recovered"] == pytest.approx(0.5)
    assert dut["recovery_longest"] == math.inf
    assert dut["frames_per_second"] == pytest.approx(20.0)
    assert math.isnan(dut["wrong_noticed"])
