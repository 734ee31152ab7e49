import numpy as np
import pytest

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.direct_actuation import Slip
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.demonstration import TaskDemonstration
from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Policy
from poil_drake.benchmarks.control.policies.scripted import pose_difference
from poil_drake.benchmarks.control.trial import ControlTrial, RunTrial, TrialConfig, pair_strains

SHOWN = TaskDemonstration("pnp_cube")


class Straight(Policy):
    """Moves straight to a known pose."""

    def __init__(self, X_WO, gain):
        self.goal, self.gain = X_WO, gain

    def step(self, state, observation):
        V = self.gain * pose_difference(observation.X_WO, self.goal)
        return state, CommandedTwist(V, observation.X_WO[:3, 3])


def run(goal, *, gain=3.0, slip=None, **config):
    arena = Arena(MakeTask("pnp_cube"), Straight(goal, gain))
    start = SHOWN.X_WO[0].copy()
    start[:2, 3] += [0.03, -0.04]
    trial = ControlTrial(task="pnp_cube", region="near", policy="straight", trial=3)
    return RunTrial(trial, arena, SHOWN, start, slip=slip, config=TrialConfig(**config))


def test_reaching_the_goal_is_a_success():
    trial = run(SHOWN.X_WO[-1])

    assert trial.success
    assert trial.collision_free
    assert trial.error < 0.001
    assert trial.strain < 1e-9


def test_ending_more_than_a_centimetre_away_is_a_failure():
    beside = SHOWN.X_WO[-1].copy()
    beside[0, 3] += 0.0105

    trial = run(beside)

    assert not trial.success
    assert trial.error == pytest.approx(0.0105, abs=0.0005)


def test_orientation_does_not_count_by_the_criterion_of_the_centre():
    turned = SHOWN.X_WO[-1].copy()
    turned[:3, :3] = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])

    assert run(turned).success


def test_trial_ends_when_the_object_has_come_to_rest():
    resting = run(SHOWN.X_WO[-1], gain=0.0, settled_time=0.5)

    assert resting.time == pytest.approx(0.5)
    assert not resting.success
    assert len(resting.path) == 5  # The start, and one each eighth of a second.


def test_slow_progress_does_not_end_the_trial():
    trial = run(SHOWN.X_WO[-1], gain=0.4)

    assert trial.error < 0.01
    assert trial.time > 8.0


def test_trial_ends_at_its_time_limit():
    trial = run(SHOWN.X_WO[-1], gain=0.05, max_time=2.0)

    assert trial.time == pytest.approx(2.0)


def test_pressing_on_the_table_is_a_collision():
    below = SHOWN.X_WO[-1].copy()
    below[2, 3] -= 0.01

    trial = run(below)

    assert trial.success
    assert not trial.collision_free
    assert trial.impulse > 0.02


def test_trial_does_not_end_before_the_slip():
    slip = Slip(4.0, 0.25, np.array([0.0, 0.0, 0.03]), np.zeros(3))

    trial = run(SHOWN.X_WO[-1], slip=slip, settled_time=0.5)

    assert trial.time >= 4.75
    heights = trial.path[:, 2]
    assert heights[round(4.25 * 8)] > heights[round(4.0 * 8)] + 0.01
    assert trial.success


def test_strain_is_the_relative_change_of_each_distance():
    first = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.2, 0]])
    stretched = first * [1.1, 1.0, 1.0]

    strains = pair_strains(np.array([first, stretched]))

    # Pairs 01, 02, 12; the last from sqrt(0.05) to sqrt(0.0521).
    np.testing.assert_allclose(strains[0], 0.0)
    np.testing.assert_allclose(strains[1], [0.1, 0.0, np.sqrt(0.0521 / 0.05) - 1.0], atol=1e-12)
