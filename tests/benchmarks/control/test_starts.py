import numpy as np
import pytest

from poil_drake.benchmarks.control import starts as dut
from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.tasks import TASKS, MakeTask
from poil_drake.benchmarks.control.demonstration import TaskDemonstration
from poil_drake.benchmarks.control.policies.scripted import ScriptedPolicy


@pytest.fixture(scope="module", params=TASKS)
def arena(request):
    task = MakeTask(request.param)
    return Arena(task, ScriptedPolicy(task.keyframes, period=1 / 16))


def draw(arena, region, trials):
    context, name = arena.diagram.CreateDefaultContext(), arena.task.name
    shape = TaskDemonstration(name).shape
    generators = [dut.trial_generator(name, region, k) for k in trials]
    return np.array([dut.sample_start(arena, context, shape, region, rng) for rng in generators])


def test_near_starts_lie_in_the_box_and_have_any_yaw(arena):
    poses = draw(arena, "near", range(40))

    offsets = poses[:, :3, 3] - arena.task.start[:3, 3]
    assert np.all(np.abs(offsets[:, :2]) <= 0.05)
    np.testing.assert_allclose(offsets[:, 2], 0.0, atol=1e-12)
    turned = poses[:, :3, :3] @ arena.task.start[:3, :3].T
    np.testing.assert_allclose(turned[:, 2, 2], 1.0, atol=1e-12)
    yaws = np.arctan2(turned[:, 1, 0], turned[:, 0, 0])
    assert yaws.min() < -2.0
    assert yaws.max() > 2.0


def test_far_starts_lie_outside_of_the_near_box(arena):
    poses = draw(arena, "far", range(40))

    offsets = poses[:, :2, 3] - arena.task.start[:2, 3]
    assert np.all(np.any(np.abs(offsets) > 0.05, axis=1))
    assert np.all((offsets >= arena.task.far_lower) & (offsets <= arena.task.far_upper))
    assert max(dut.distance_to_near(arena.task, pose[:3, 3]) for pose in poses) > 0.2


def test_hard_starts_have_any_orientation(arena):
    poses = draw(arena, "hard", range(40))

    # Of random rotations, half have their z axis below the horizon.
    upright = poses[:, :3, 2] @ arena.task.start[:3, 2]
    assert 8 <= np.count_nonzero(upright < 0.0) <= 32


@pytest.mark.parametrize("region", ["near", "far", "hard"])
def test_starts_are_clear_of_everything(arena, region):
    context = arena.diagram.CreateDefaultContext()
    shape = TaskDemonstration(arena.task.name).shape

    for pose in draw(arena, region, range(10)):
        arena.place(context, pose, shape)
        distances = arena.clearance(context, 0.02)
        assert distances.pop("table", 1.0) > 0.002
        assert min(distances.values(), default=1.0) > dut.CLEARANCE


def test_start_depends_on_the_trial_only(arena):
    later = draw(arena, "far", range(3))[2]

    (alone,) = draw(arena, "far", [2])

    np.testing.assert_array_equal(alone, later)


def test_distance_is_that_to_the_box():
    task = MakeTask("pnp_cube")
    beside = task.start[:3, 3] + np.array([0.08, 0.09, 0.3])

    # 3 cm and 4 cm beyond the box of 5 cm.
    assert dut.distance_to_near(task, beside) == pytest.approx(0.05)
    assert dut.distance_to_near(task, task.start[:3, 3]) == 0.0
