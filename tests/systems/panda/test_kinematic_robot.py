import numpy as np
import pytest
from system_bench import SystemBench

from poil_drake.systems.panda.kinematic_robot import KinematicRobot

PERIOD = 1 / 256
START = np.linspace(-0.3, 0.3, 7)
WANTED = np.linspace(0.1, -0.2, 7)


@pytest.fixture
def bench() -> SystemBench:
    unknown = {"real_position": np.full(7, np.nan), "real_width": np.nan}
    return SystemBench(KinematicRobot(period=PERIOD), **unknown)


@pytest.fixture
def started(bench: SystemBench) -> SystemBench:
    bench.fix(real_position=START, real_width=0.06)
    bench.advance(PERIOD)
    return bench


def test_before_the_real_robot_is_measured_nothing_is_known(bench: SystemBench) -> None:
    bench.fix(velocity=WANTED)
    bench.advance(0.25)

    assert np.isnan(bench.read("position_measured")).all()
    assert np.isnan(bench.read("width_measured")).all()


def test_it_starts_at_the_posture_of_the_real_robot(bench: SystemBench) -> None:
    bench.fix(real_position=START, real_width=0.06)

    for _ in range(2):
        np.testing.assert_array_equal(bench.read("position_measured"), START)
        assert bench.read("width_measured")[0] == 0.06
        bench.advance(PERIOD)


def test_velocities_are_integrated_independently_of_the_real_robot(started: SystemBench) -> None:
    started.fix(velocity=WANTED, real_position=np.zeros(7))
    started.advance(0.5)

    np.testing.assert_allclose(started.read("position_measured"), START + 0.5 * WANTED, atol=1e-12)
    np.testing.assert_array_equal(started.read("velocity_measured"), WANTED)
    np.testing.assert_array_equal(started.read("torque_external"), 0.0)


def test_it_rests_without_a_command(started: SystemBench) -> None:
    started.advance(0.25)
    started.fix(velocity=np.full(7, np.nan), width=np.nan)
    started.advance(0.25)

    np.testing.assert_array_equal(started.read("position_measured"), START)
    assert started.read("width_measured")[0] == 0.06


def test_the_hand_closes_at_its_speed_and_holds_something(started: SystemBench) -> None:
    started.fix("width", 0.0)
    started.advance(0.25)
    on_its_way = started.read("width_measured")[0]
    started.advance(1.0)

    assert on_its_way == pytest.approx(0.06 - 0.25 * 0.1)
    assert started.read("width_measured")[0] == 0.005
