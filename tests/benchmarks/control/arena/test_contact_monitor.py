import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from poil_drake.benchmarks.control.arena.arena import Arena
from poil_drake.benchmarks.control.arena.tasks import MakeTask
from poil_drake.benchmarks.control.policies.policy import CommandedTwist, Policy
from poil_drake.geometry.rigid_transform import make_transform


class Push(Policy):
    """Commands a constant velocity."""

    period = 1 / 16

    def __init__(self, velocity):
        self.V = np.array([0, 0, 0, *velocity], dtype=float)

    def step(self, state, observation):
        return state, CommandedTwist(self.V, observation.X_WO[:3, 3])


def run(velocity, position, duration, intended=None):
    arena = Arena(MakeTask("pnp_cube"), Push(velocity), intended_contact=intended)
    simulator = Simulator(arena.diagram)
    context = simulator.get_mutable_context()
    arena.place(context, make_transform(np.eye(3), np.array(position)), np.zeros(0))
    simulator.Initialize()
    simulator.AdvanceTo(duration)
    first = arena.contact(context)
    simulator.AdvanceTo(duration + 1.0)
    return arena, context, first, arena.contact(context)


def test_object_that_touches_nothing_has_no_contact():
    _, _, _, second = run([0.1, 0, 0], [0.4, 0, 0.3], 0.5)

    assert second == (0.0, 0.0)


def test_impulse_is_force_times_time():
    _, _, first, second = run([0, 0, -0.2], [0.4, 0, 0.03], 1.0)

    # Held against the table the cube misses 0.2 m/s: 60 / s * 0.08 kg * 0.2 m/s = 0.96 N.
    assert second[0] - first[0] == pytest.approx(0.96, rel=0.01)
    assert 0.0 < second[1] < 0.001


def test_contact_counts_unless_it_is_intended_there():
    arena, context, _, _ = run([0, 0, -0.2], [0.4, 0, 0.03], 1.0)
    resting = arena.points(context)

    here, elsewhere = (
        run([0, 0, -0.2], [0.4, 0, 0.03], 1.0, intended=resting[None] + [shift, 0.0, 0.0])[3]
        for shift in (0.0, 0.02)
    )

    assert here == (0.0, 0.0)
    assert elsewhere[0] > 0.5
