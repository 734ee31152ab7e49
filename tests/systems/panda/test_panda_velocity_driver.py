import math

import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.robots.joint_limits import JointLimits
from poil_drake.systems.panda.velocity_driver import PandaDriver, PandaVelocityDriver, step_joints
from poil_drake.systems.statuses import RobotMode

TIME_STEP = 1 / 512
LIMITS = JointLimits(
    lower=np.full(7, -2.0), upper=np.full(7, 2.0), velocity=np.ones(7), acceleration=np.full(7, 10)
)
# No filter and no leash, for tests of other properties.
PLAIN = PandaDriver(low_pass_hz=1e9, leash=10.0)


def step(
    *,
    position: float = 0.0,
    velocity: float = 0.0,
    wanted: float = 0.0,
    measured: float | None = None,
    config: PandaDriver = PLAIN,
) -> tuple[float, float]:
    """Advances one of seven identical joints."""
    measured = position if measured is None else measured
    state = {"position": position, "velocity": velocity, "wanted": wanted, "measured": measured}
    positions, velocities = step_joints(
        **{name: np.full(7, value) for name, value in state.items()},
        limits=LIMITS,
        config=config,
        time_step=TIME_STEP,
    )
    return positions[0], velocities[0]


def test_speed_builds_up_at_the_acceleration_limit_to_its_own() -> None:
    # From rest 10 rad/s^2 give 10/512 rad/s in a step, which moves the joint 10/512^2 rad.
    assert step(wanted=1.0) == pytest.approx((10 / 512**2, 10 / 512))
    assert step(velocity=1.0, wanted=5.0)[1] == pytest.approx(1.0)


def test_the_low_pass_takes_a_time_constant_to_two_thirds() -> None:
    # 1 / (2 pi f) is the time constant: after it 1 - 1/e = 0.632 of a (small) step is reached.
    config = PandaDriver(low_pass_hz=2.0, leash=10.0)
    v = 0.0
    for _ in range(round(512 / (2 * math.pi * 2.0))):
        _, v = step(velocity=v, wanted=0.1, config=config)

    assert v == pytest.approx(0.1 * 0.632, rel=0.02)


def test_a_joint_brakes_before_its_limit() -> None:
    q, v, fastest_change = 1.5, 1.0, 0.0
    for _ in range(1024):
        q, new = step(position=q, velocity=v, wanted=1.0)
        fastest_change, v = max(fastest_change, abs(new - v) * 512), new

    assert q == pytest.approx(2.0 - PLAIN.limit_margin, abs=1e-3)
    assert q <= 2.0 - PLAIN.limit_margin
    assert v == pytest.approx(0.0, abs=0.02)
    assert fastest_change < 10.001


def test_a_blocked_arm_does_not_wind_up() -> None:
    config = PandaDriver(low_pass_hz=1e9, leash=0.05)
    q, v = 0.0, 0.0
    for _ in range(1024):
        q, v = step(position=q, velocity=v, wanted=1.0, measured=0.0, config=config)

    assert q == pytest.approx(0.05)
    # It reverses at once: after one step it has left the end of its leash.
    q, v = step(position=q, velocity=v, wanted=-1.0, measured=0.0, config=config)
    assert q < 0.05


@pytest.fixture
def bench() -> SystemBench:
    """The arm is measured at 0.5 rad."""
    dut = PandaVelocityDriver(limits=LIMITS, config=PLAIN, time_step=TIME_STEP)
    return SystemBench(dut, position_measured=np.full(7, 0.5))


def velocity_after(bench: SystemBench, duration: float) -> float:
    bench.advance(duration)
    return bench.read("velocity_commanded")[0]


def test_without_a_command_the_arm_holds_still(bench: SystemBench) -> None:
    np.testing.assert_array_equal(bench.read("position_commanded"), np.full(7, 0.5))
    np.testing.assert_array_equal(bench.read("velocity_commanded"), 0)
    np.testing.assert_array_equal(bench.read("status"), [RobotMode.MOVE, 0.0, 1.0])

    assert velocity_after(bench, 0.5) == 0
    assert bench.read("position_commanded")[0] == 0.5
    # Commands act only through the state.
    command, outputs = bench.dut.GetInputPort("velocity").get_index(), bench.dut.num_output_ports()
    assert not any(bench.dut.HasDirectFeedthrough(command, output) for output in range(outputs))


def test_a_command_without_stamps_is_followed_and_a_stamped_one_expires(
    bench: SystemBench,
) -> None:
    bench.fix(velocity=np.full(7, 0.3))
    assert velocity_after(bench, 0.5) == pytest.approx(0.3)

    bench.fix(velocity_time=0.5)
    assert velocity_after(bench, 0.09) == pytest.approx(0.3)
    # It expires after 0.1 s, and braking from 0.3 rad/s at 10 rad/s^2 takes 0.03 s.
    assert velocity_after(bench, 0.05) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("velocity", "time"), [(math.nan, 0.0), (0.3, math.nan), (math.inf, 0.0)])
def test_a_command_that_is_not_finite_means_zero(
    bench: SystemBench, velocity: float, time: float
) -> None:
    command = np.full(7, 0.3)
    command[3] = velocity
    bench.fix(velocity=command, velocity_time=time)

    assert velocity_after(bench, 0.05) == 0


def test_a_step_is_that_of_the_pure_function_for_every_joint() -> None:
    config = PandaDriver(low_pass_hz=30.0, leash=0.05)
    wanted = np.array([0.3, -0.3, 2.0, -2.0, 0.0, 0.01, 1.0])
    bench = SystemBench(
        PandaVelocityDriver(limits=LIMITS, config=config, time_step=TIME_STEP),
        position_measured=np.full(7, 0.5),
        velocity=wanted,
    )

    bench.advance(TIME_STEP / 2)

    expected = [step(position=0.5, wanted=w, measured=0.5, config=config) for w in wanted]
    found = [bench.read(f"{name}_commanded") for name in ("position", "velocity")]
    np.testing.assert_array_equal(np.transpose(found), expected)


def test_a_nan_measurement_leaves_the_commands_finite(bench: SystemBench) -> None:
    bench.fix(velocity=np.full(7, 0.3))
    bench.advance(0.1)
    bench.fix(position_measured=np.full(7, math.nan))

    assert velocity_after(bench, 0.1) == pytest.approx(0.3)
    assert np.isfinite(bench.read("position_commanded")).all()


def test_after_a_reset_it_holds_the_measured_position(bench: SystemBench) -> None:
    bench.fix(velocity=np.full(7, 0.3))
    bench.advance(0.2)
    bench.fix(position_measured=np.full(7, -1.0))

    bench.dut.Reset(bench.context)

    assert bench.read("position_commanded")[0] == -1.0
    assert bench.read("velocity_commanded")[0] == 0.0
