import numpy as np
import pytest
from point_references import moving_reference

from poil_drake.control.field.batched_rollout import batched_rollout as dut
from poil_drake.control.field.point_set_bcsdm import BcsdmConfig
from poil_drake.control.field.rollout import rollout
from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, TrackingError
from poil_drake.geometry.rigid_transform import rotation_exp

STARTS = 12


def arc_reference() -> PointTrajectory:
    """A third of a circle in the xy plane that seven points turn with, slowing down to rest."""
    angles = 2.0 * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 61))
    body = np.random.default_rng(0).normal(scale=0.04, size=(7, 3))
    turns = rotation_exp(angles[:, None] * np.array([0.0, 0.0, 1.0]))
    return moving_reference((body + np.array([0.3, 0.0, 0.1])) @ turns.swapaxes(-1, -2), 0.05)


def random_starts(reference: PointTrajectory) -> np.ndarray:
    rng = np.random.default_rng(1)
    centre = reference.positions[0].mean(axis=0)
    turns = rotation_exp(rng.normal(scale=0.8, size=(STARTS, 3)))
    places = centre + rng.normal(scale=0.2, size=(STARTS, 1, 3))
    return (reference.positions[0] - centre) @ turns.swapaxes(-1, -2) + places


@pytest.mark.parametrize("window", [None, (0.3, 0.3)])
@pytest.mark.parametrize("limited", [False, True])
def test_every_run_is_the_single_rollout(limited, window):
    reference = arc_reference()
    starts = random_starts(reference)
    starts[0] = reference.positions[-1]
    config = BcsdmConfig(progress_window=window)
    grippers = starts[:, 0] + [0.0, 0.0, 0.1]
    limits = {"max_angular_speed": 0.8, "max_linear_speed": 0.15} if limited else {}

    runs = dut(
        starts,
        reference,
        config,
        max_time=8.0,
        limited_points=grippers if limited else None,
        **limits,
    )

    for b, run in enumerate(runs):
        single = rollout(
            starts[b],
            reference,
            config,
            max_time=8.0,
            limited_point=grippers[b] if limited else None,
            **limits,
        )
        assert run.converged == single.converged
        np.testing.assert_array_equal(run.times, single.times)
        np.testing.assert_allclose(run.X_W, single.X_W, atol=1e-9)
        np.testing.assert_allclose(run.taus, single.taus, atol=1e-9)
        np.testing.assert_allclose(run.potentials, single.potentials, atol=1e-9)
    assert len({len(run.times) for run in runs}) > 5
    assert len(runs[0].times) == 1


def test_runs_that_run_out_of_time_have_not_converged():
    reference = arc_reference()
    starts = np.stack([reference.positions[0], reference.positions[-1]])

    slow, arrived = dut(starts, reference, BcsdmConfig(), 1.0 / 32.0, 0.5)

    assert not slow.converged
    assert slow.times[-1] == 0.5
    assert arrived.converged


def test_no_starts_give_no_runs():
    assert dut(np.zeros((0, 7, 3)), arc_reference(), BcsdmConfig()) == []


def test_lost_starts_and_invalid_steps_are_rejected():
    reference = arc_reference()
    starts = random_starts(reference)[:3]

    with pytest.raises(InvalidValueError, match="time_step"):
        dut(starts, reference, BcsdmConfig(), 0.0)
    starts[1] = starts[1, :1]
    with pytest.raises(TrackingError, match=r"\[1\]"):
        dut(starts, reference, BcsdmConfig())
