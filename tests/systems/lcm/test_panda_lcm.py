"""Statuses of the drivers of the Panda and its hand."""

import contextlib

import numpy as np
import pytest
from drake import lcmt_panda_status, lcmt_schunk_wsg_status
from hypothesis import given, settings
from hypothesis import strategies as st
from panda_bench import JOINTS, PERIOD, RobotBench, arm_status, hand_status
from system_bench import START

from poil_drake.errors import InvalidValueError
from poil_drake.systems.lcm.panda_messages import decode_hand_status, decode_panda_status
from poil_drake.systems.statuses import RobotMode


@pytest.mark.parametrize("age", [0.02, -1.0])
def test_status_is_shown_in_the_signs_of_drake(arm: RobotBench, age: float) -> None:
    arm.report(arm_status(START - age))

    np.testing.assert_array_equal(arm.show("position_measured"), JOINTS)
    np.testing.assert_allclose(arm.show("velocity_measured"), 0.01 * np.arange(7))
    np.testing.assert_array_equal(arm.show("torque_external"), -np.arange(7.0))
    assert arm.show("status") == pytest.approx([RobotMode.MOVE, age, 0.98], abs=1e-6)


def test_age_grows_when_statuses_stop_repeat_or_come_late(arm: RobotBench) -> None:
    arm.report(arm_status(START))
    arm.elapsed += 0.3

    arm.report(arm_status(START))
    arm.report(arm_status(START - 0.1, joint_position=[0.0] * 7))

    assert arm.show("status")[1] == pytest.approx(0.3, abs=1e-6)
    np.testing.assert_array_equal(arm.show("position_measured"), JOINTS)
    assert arm.mailbox.late == 2


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"abc",
        arm_status(START)[:-5],
        lcmt_schunk_wsg_status().encode(),
        arm_status(START, joint_position=[np.nan] * 7),
        arm_status(START, robot_mode=42),
        lcmt_panda_status().encode(),  # Without joints.
    ],
    ids=["empty", "noise", "cut off", "foreign", "not finite", "no mode", "no joints"],
)
def test_malformed_statuses_change_nothing(arm: RobotBench, message: bytes) -> None:
    arm.report(arm_status(START))

    arm.report(message)

    assert arm.mailbox.malformed == 1
    np.testing.assert_array_equal(arm.show("position_measured"), JOINTS)
    with pytest.raises(InvalidValueError, match="Panda status"):
        decode_panda_status(message)


@given(st.binary(max_size=600), st.booleans())
@settings(derandomize=True, max_examples=300)
def test_any_message_raises_at_most_an_invalid_value_error(noise: bytes, own: bool) -> None:
    message = arm_status(START)[:8] + noise if own else noise
    for decode in (decode_panda_status, decode_hand_status):
        with contextlib.suppress(InvalidValueError):
            decode(message)


def test_width_of_the_hand_is_shown_while_it_is_recent(hand: RobotBench) -> None:
    assert np.isnan(hand.show("width_measured"))

    hand.report(hand_status(0.035))

    assert hand.show("width_measured") == pytest.approx(0.035)
    hand.elapsed += 0.6
    # The grace time lets a fault of the whole robot be reported first.
    shown = [hand.show("width_measured") for _ in range(round(0.12 / PERIOD))]
    assert shown[0] == pytest.approx(0.035)
    assert np.isnan(shown[-1])


def test_malformed_statuses_of_the_hand_change_nothing(hand: RobotBench) -> None:
    hand.report(hand_status(0.035))

    hand.report(hand_status(float("nan"), START + 0.1))
    hand.report(arm_status(START + 0.2))

    assert hand.mailbox.malformed == 2
    assert hand.show("width_measured") == pytest.approx(0.035)


def test_a_restarted_driver_is_one_driver(arm: RobotBench) -> None:
    for k in range(40):
        clock = 0.001 * k + (1e3 if k > 20 else 0.0)
        arm.report(arm_status(START + 0.001 * k, robot_utime=round(1e6 * clock)))

    assert arm.show("status")[0] == RobotMode.MOVE
