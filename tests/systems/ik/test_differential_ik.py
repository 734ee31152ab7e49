import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.errors import InvalidValueError
from poil_drake.robots.differential_ik import DifferentialInverseKinematicsConfig, resolve_twist
from poil_drake.systems.ik.arm_kinematics import ArmKinematics
from poil_drake.systems.ik.differential_ik import DifferentialInverseKinematics
from poil_drake.systems.statuses import IkStatus

PERIOD = 1 / 256
CONFIG = DifferentialInverseKinematicsConfig(nominal_posture=(0.0,) * 7)
ALONG_X = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0])


class ArmBench(SystemBench):
    """The dut and an arm that integrates its commands."""

    positions = np.zeros(7)

    def step(self, twist: np.ndarray, positions: np.ndarray | None = None) -> np.ndarray:
        """Runs one update and returns the velocity that it commands."""
        self.fix("position_measured", self.positions if positions is None else positions)
        self.fix(spatial_velocity=twist)
        self.advance(PERIOD)
        velocity = self.read("velocity")
        self.positions = self.positions + PERIOD * velocity
        return velocity

    def settle(self, twist: np.ndarray, ticks: int = 100) -> np.ndarray:
        for _ in range(ticks):
            velocity = self.step(twist)
        return velocity


@pytest.fixture
def bench(gantry: ArmKinematics) -> ArmBench:
    return ArmBench(DifferentialInverseKinematics(kinematics=gantry, period=PERIOD, config=CONFIG))


def test_before_the_first_update_nothing_moves(bench: ArmBench) -> None:
    assert not bench.dut.HasAnyDirectFeedthrough()
    np.testing.assert_array_equal(bench.read("velocity"), np.zeros(7))
    assert bench.read("scale") == 1.0
    assert bench.read("status") == IkStatus.OK
    assert bench.read("command_time") == -np.inf


def test_a_free_motion_is_shared_by_the_joints_that_can_make_it(bench: ArmBench) -> None:
    velocity = bench.settle(ALONG_X, ticks=20)

    # Two slides along x: the least-norm answer is half the speed each; both are equally far from
    # the nominal posture, which pulls neither.
    np.testing.assert_allclose(velocity, [0.1, 0.1, 0, 0, 0, 0, 0], atol=1e-12)
    assert bench.read("scale") == pytest.approx(1.0)
    assert bench.read("status") == IkStatus.OK
    assert bench.read("command_time") == 19 * PERIOD


def test_the_answer_is_that_of_the_pure_function(bench: ArmBench, gantry: ArmKinematics) -> None:
    positions = np.array([0.1, -0.3, 0.2, 0.5, 0.0, 0.0, 0.0])
    twist = np.array([0.3, -0.2, 0.5, 0.4, 0.1, -0.6])
    # At zero turns: ω from the three turns, v from the slides, two of them along x.
    J = np.zeros((6, 7))
    J[3, 0] = J[3, 1] = J[4, 2] = J[5, 3] = J[0, 4] = J[1, 5] = J[2, 6] = 1.0
    limits = gantry.joint_limits
    expected = resolve_twist(twist, J, positions, np.zeros(7), limits, CONFIG, PERIOD)

    velocity = bench.step(twist, positions)

    np.testing.assert_allclose(velocity, expected.velocity, atol=1e-12)
    assert bench.read("scale") == pytest.approx(expected.scale, abs=1e-12)


def test_at_a_joint_limit_it_slows_down_and_is_stuck(bench: ArmBench) -> None:
    up = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    statuses = []
    for _ in range(2000):
        bench.step(up)
        statuses.append(bench.read("status")[0])

    assert bench.positions[3] == pytest.approx(2.0 - CONFIG.position_margin, abs=1e-3)
    assert statuses[100] == IkStatus.OK
    assert statuses[-1] == IkStatus.STUCK
    assert IkStatus.LIMITED in statuses[101:-1]
    assert bench.step(-up)[3] < 0.0


def test_an_input_that_is_not_finite_keeps_an_arm_at_rest(bench: ArmBench) -> None:
    for twist, positions in (
        (np.full(6, np.nan), np.zeros(7)),
        (ALONG_X, np.full(7, np.nan)),
        (np.full(6, np.inf), np.zeros(7)),
    ):
        np.testing.assert_array_equal(bench.step(twist, positions), np.zeros(7))
        assert bench.read("status") == IkStatus.INVALID_INPUT
        assert bench.read("scale") == 0.0


def test_an_input_that_is_not_finite_stops_a_moving_arm_without_a_jump(bench: ArmBench) -> None:
    velocity = bench.settle(3.0 * ALONG_X, ticks=50)
    assert velocity[0] == pytest.approx(0.3)

    # 0.3 m/s at 6.4 m/s^2 takes 12 periods, and rounding perhaps one more.
    for _ in range(13):
        slower = bench.step(np.full(6, np.nan))
        assert np.all(np.abs(slower - velocity) <= 6.4 * PERIOD + 1e-12)
        velocity = slower

    np.testing.assert_array_equal(velocity, np.zeros(7))
    assert bench.read("status") == IkStatus.INVALID_INPUT
    assert bench.read("command_time") == 62 * PERIOD


def test_a_posture_of_another_arm_is_refused(two_joint_arm: ArmKinematics) -> None:
    with pytest.raises(InvalidValueError, match="nominal_posture has 7 values"):
        DifferentialInverseKinematics(kinematics=two_joint_arm, period=PERIOD)
