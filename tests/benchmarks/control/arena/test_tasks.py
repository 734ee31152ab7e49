import numpy as np
import pytest

from poil_drake.benchmarks.control.arena.tasks import TASKS, MakeTask
from poil_drake.benchmarks.control.demonstration import (
    NearDemonstrations,
    TaskDemonstration,
    TaskReference,
)
from poil_drake.benchmarks.control.trial import goal_error, pair_strains
from poil_drake.control.theory.stability import moment_matrix

RIGID = [name for name in TASKS if MakeTask(name).rigid]
each_task = pytest.mark.parametrize("name", TASKS)


@pytest.mark.parametrize("name", RIGID)
def test_demonstration_of_a_rigid_object_touches_nothing_and_arrives(name):
    task, shown = MakeTask(name), TaskDemonstration(name)

    assert not shown.touching.any()
    np.testing.assert_allclose(shown.X_WO[0], task.keyframes[0], atol=1e-3)
    np.testing.assert_allclose(shown.X_WO[-1], task.keyframes[-1], atol=1e-3)


def test_bag_hangs_on_its_strap_in_the_end_and_not_before():
    shown = TaskDemonstration("hanging_bag")

    first = int(np.argmax(shown.touching))
    assert shown.touching[first:].mean() > 0.9
    assert first > 0.7 * len(shown.times)


@each_task
def test_only_rigid_objects_keep_their_shape(name):
    strain = pair_strains(TaskDemonstration(name).points).max()

    assert strain < 1e-9 if MakeTask(name).rigid else strain > 0.05


@each_task
def test_reference_ends_where_the_demonstration_does(name):
    shown, reference = TaskDemonstration(name), TaskReference(name)

    errors = np.linalg.norm(reference.positions[-1] - shown.points[-1], axis=1)
    assert errors.max() < 0.001
    assert np.linalg.norm(reference.positions[0] - shown.points[0], axis=1).max() < 0.005


@each_task
def test_points_determine_every_rotation(name):
    eigenvalues = np.linalg.eigvalsh(moment_matrix(TaskDemonstration(name).points[0]))

    # Root mean square distances from the axes [m].
    assert np.sqrt((eigenvalues[0] + eigenvalues[1]) / 10) > 0.002
    assert np.min(np.diff(eigenvalues)) > 0.01 * eigenvalues[-1]


def test_near_demonstrations_start_elsewhere_and_end_in_the_same_place():
    shown = TaskDemonstration("pnp_cube")

    first, second = NearDemonstrations("pnp_cube", 2)

    assert np.linalg.norm(first.X_WO[0] - second.X_WO[0]) > 0.01
    for one in (first, second):
        assert goal_error("points", one.points[-1], one.X_WO[-1], shown) < 0.002
        assert not one.touching.any()


def test_goal_error_is_that_of_centre_or_points():
    shown = TaskDemonstration("pnp_cube")
    X_WO = shown.X_WO[-1].copy()
    X_WO[0, 3] += 0.03

    moved = shown.points[-1] + np.array([0.0, 0.004, 0.0])

    assert goal_error("center", moved, X_WO, shown) == pytest.approx(0.03)
    assert goal_error("points", moved, X_WO, shown) == pytest.approx(0.004)
