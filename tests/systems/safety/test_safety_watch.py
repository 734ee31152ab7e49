import math

import pytest

from poil_drake.systems.safety import watch as dut
from poil_drake.systems.safety.faults import SafetyConfig, SafetyFault
from poil_drake.systems.statuses import RobotMode

PERIOD = 1 / 256
CONFIG = SafetyConfig()
WELL = dut.SafetyObservation(
    mode=float(RobotMode.MOVE),
    status_age=0.001,
    success_rate=1.0,
    position_known=True,
    torque_ratio=0.1,
    tracking_error=0.01,
    standing=False,
    command_finite=True,
    command_age=PERIOD,
    image_age=0.1,
    image_ahead=0.0,
    stalled=0.0,
    stops=0.0,
    resets=0.0,
)


def watch(memory: dut.SafetyMemory, ticks: int = 1, **changes) -> dut.SafetyMemory:
    for _ in range(ticks):
        memory = dut.watch(memory, WELL._replace(**changes), CONFIG, PERIOD)
    return memory


def watch_age(memory: dut.SafetyMemory, ages) -> list[SafetyFault]:
    """Returns the fault after each of some ages of the status."""
    faults = []
    for age in ages:
        memory = watch(memory, status_age=age)
        faults.append(SafetyFault(int(memory.fault)))
    return faults


@pytest.fixture
def moving() -> dut.SafetyMemory:
    """A second without a fault."""
    memory = watch(dut.SafetyMemory(), 256)
    assert memory.fresh
    assert memory.fault == SafetyFault.NONE
    return memory


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"stops": 1.0}, SafetyFault.STOP_REQUESTED),
        ({"stops": math.nan}, SafetyFault.STOP_REQUESTED),
        ({"status_age": math.nan}, SafetyFault.NO_STATUS),
        ({"status_age": math.inf}, SafetyFault.NO_STATUS),
        ({"position_known": False}, SafetyFault.NO_STATUS),
        ({"mode": float(RobotMode.USER_STOPPED)}, SafetyFault.ROBOT_MODE),
        ({"mode": float(RobotMode.IDLE)}, SafetyFault.ROBOT_MODE),
        ({"mode": math.nan}, SafetyFault.ROBOT_MODE),
        ({"tracking_error": 0.11}, SafetyFault.TRACKING_ERROR),
        ({"command_finite": False}, SafetyFault.COMMAND_NOT_FINITE),
        ({"command_age": 0.06}, SafetyFault.COMMAND_STALE),
        ({"command_age": math.nan}, SafetyFault.COMMAND_STALE),
        ({"command_age": math.inf}, SafetyFault.COMMAND_STALE),
        ({"image_age": 1.01}, SafetyFault.CAMERA_STALE),
        ({"image_ahead": 0.06}, SafetyFault.CAMERA_CLOCK),
        ({"stalled": 0.09}, SafetyFault.LOOP_STALLED),
        # The most severe fault counts.
        ({"stops": 1.0, "mode": 0.0, "command_finite": False}, SafetyFault.STOP_REQUESTED),
        ({"mode": 0.0, "command_finite": False}, SafetyFault.ROBOT_MODE),
    ],
)
def test_each_cause_is_a_fault_at_once(moving: dut.SafetyMemory, changes: dict, fault) -> None:
    assert watch(moving, **changes).fault == fault


@pytest.mark.parametrize(
    "changes",
    [
        {"tracking_error": 0.09},
        {"command_age": 0.049},
        {"image_age": 0.99},
        {"status_age": 0.049},
        {"status_age": -0.049},
        {"success_rate": 0.9},
        {"torque_ratio": 1.0},
        {"resets": 1.0},
    ],
)
def test_values_within_their_limits_are_no_fault(moving: dut.SafetyMemory, changes: dict) -> None:
    assert watch(moving, 1000, **changes).fault == SafetyFault.NONE


@pytest.mark.parametrize(
    ("changes", "fault", "ticks"),
    [
        # 0.03 s are 7.68 periods, 0.5 s are 128.
        ({"torque_ratio": 1.01}, SafetyFault.EXTERNAL_TORQUE, 8),
        ({"torque_ratio": math.nan}, SafetyFault.EXTERNAL_TORQUE, 8),
        ({"success_rate": 0.89}, SafetyFault.SUCCESS_RATE, 129),
        ({"success_rate": math.nan}, SafetyFault.SUCCESS_RATE, 129),
    ],
)
def test_some_causes_must_last(moving: dut.SafetyMemory, changes: dict, fault, ticks) -> None:
    shorter = watch(moving, ticks - 1, **changes)
    longer = watch(moving, ticks, **changes)
    # A moment without the cause restarts the count.
    interrupted = watch(watch(shorter), ticks - 1, **changes)

    assert shorter.fault == SafetyFault.NONE
    assert longer.fault == fault
    assert interrupted.fault == SafetyFault.NONE


@pytest.mark.parametrize(
    "changes",
    [
        {"command_finite": False},
        {"mode": 0.0},
        {"success_rate": 0.0},
        {"torque_ratio": math.nan},
        {"tracking_error": math.nan},
        {"command_age": math.inf},
        {"image_age": 5.0},
        {"position_known": False},
    ],
)
def test_before_the_first_status_only_a_stop_is_a_fault(changes: dict) -> None:
    nothing = {"status_age": math.inf, "position_known": False} | changes
    waiting = watch(dut.SafetyMemory(), 512, **nothing)

    assert waiting.fault == SafetyFault.NONE
    assert not waiting.fresh
    assert watch(waiting, **nothing, stops=1.0).fault == SafetyFault.STOP_REQUESTED


def test_no_velocity_is_old_before_the_first_one() -> None:
    memory = watch(dut.SafetyMemory(), 256, command_age=math.inf)

    assert memory.fault == SafetyFault.NONE
    assert watch(watch(memory), command_age=math.inf).fault == SafetyFault.COMMAND_STALE


def test_a_status_that_grows_old_is_a_silent_driver(moving: dut.SafetyMemory) -> None:
    # The last status is 1 ms old, and exceeds 0.05 s after 13 periods.
    ages = [0.001 + tick * PERIOD for tick in range(1, 40)]

    faults = watch_age(moving, ages)

    assert faults[:12] == [SafetyFault.NONE] * 12
    assert set(faults[12:]) == {SafetyFault.NO_STATUS}


@pytest.mark.parametrize("offset", [0.6, 100.0, -0.06, -100.0])
def test_a_jump_of_the_clock_is_no_silence(moving: dut.SafetyMemory, offset: float) -> None:
    # Statuses keep arriving: their age stays constant.
    faults = watch_age(moving, [offset + 0.001] * 30)

    assert set(faults[7:]) == {SafetyFault.CLOCK_OFF}
    assert set(faults) == {SafetyFault.NONE, SafetyFault.CLOCK_OFF}
    assert not watch(moving, status_age=offset).fresh


@pytest.mark.parametrize("offset", [100.0, -100.0])
def test_a_clock_that_is_off_from_the_start_is_a_fault(offset: float) -> None:
    # Statuses arrive every third period, so that their age is a sawtooth.
    ages = [offset + (tick % 3) * PERIOD for tick in range(30)]

    faults = watch_age(dut.SafetyMemory(), ages)

    assert faults[-1] is SafetyFault.CLOCK_OFF
    assert SafetyFault.NO_STATUS not in faults


@pytest.mark.parametrize(
    ("ages", "fault"),
    [
        ([0.2] * 30, SafetyFault.NO_STATUS),  # Late statuses do not mean a wrong clock.
        # A delay of this process: the status is old for one tick, until the queue is read.
        ([0.001, 0.3, 0.001, 0.001], SafetyFault.NONE),
        # Silence after a jump of the clock.
        ([0.6 + tick * PERIOD for tick in range(30)], SafetyFault.NO_STATUS),
    ],
)
def test_late_statuses_delays_and_silence_differ(moving: dut.SafetyMemory, ages, fault) -> None:
    assert watch_age(moving, ages)[-1] is fault


def test_a_fault_stays_when_its_cause_ends_or_another_occurs(moving: dut.SafetyMemory) -> None:
    faulty = watch(moving, mode=0.0)

    assert watch(faulty, 256, standing=True).fault == SafetyFault.ROBOT_MODE
    assert watch(faulty, stops=1.0).fault == SafetyFault.ROBOT_MODE


@pytest.mark.parametrize(
    "changes",
    [
        {"resets": 1.0, "mode": 0.0},  # The cause persists.
        {"resets": 1.0, "command_finite": False},  # Another cause occurs.
        {"resets": 1.0, "standing": False},  # The arm is still braking.
        {"resets": 1.0, "stops": 1.0},
        {"resets": 1.0, "status_age": 0.6},  # The cause of the old status is still unknown.
        {"resets": math.nan},
        {"resets": 0.0},
    ],
)
def test_a_reset_releases_only_an_arm_at_rest_without_a_cause(
    moving: dut.SafetyMemory, changes
) -> None:
    faulty = watch(moving, mode=0.0)
    assert watch(faulty, standing=True, resets=1.0).fault == SafetyFault.NONE
    refused = watch(faulty, **({"standing": True} | changes))

    assert refused.fault == SafetyFault.ROBOT_MODE
    # It is not remembered, either.
    late = {"standing": True, "resets": changes["resets"], "stops": changes.get("stops", 0.0)}
    assert watch(refused, **late).fault == SafetyFault.ROBOT_MODE


def test_a_stop_before_the_first_status_can_be_reset() -> None:
    nothing = {"status_age": math.inf, "position_known": False, "standing": True}
    stopped = watch(dut.SafetyMemory(), stops=1.0, **nothing)

    released = watch(stopped, stops=1.0, resets=1.0, **nothing)

    assert stopped.fault == SafetyFault.STOP_REQUESTED
    assert released.fault == SafetyFault.NONE
