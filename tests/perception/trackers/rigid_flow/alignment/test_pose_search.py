import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, rotation_angle
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import move
from poil_drake.perception.trackers.rigid_flow.alignment.pose_search import (
    Guess,
    score_poses,
    search,
)
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import build_model

CONFIG = RigidFlowConfig()


@pytest.fixture(scope="module")
def mug(mug_scene):
    """The mug's model, its pose and the frame that it was made from."""
    shot = mug_scene.shoot(mug_scene.start)
    model, X_WO = build_model(shot.frame, mug_scene.handle_points, shot.masks, CONFIG)
    return model, X_WO, shot.frame


def test_the_true_pose_scores_best(mug):
    model, X_WO, frame = mug
    turned, moved = ([0.0, 0.0, 0.5, 0, 0, 0], [0, 0, 0, 0.0, 0.0, 0.03])
    poses = np.stack([X_WO, move(X_WO, np.array(turned)), move(X_WO, np.array(moved))])

    scores = score_poses(model.aligned, frame, poses, 0.008, CONFIG)

    # What one camera sees and the other does not takes some off.
    assert 0.6 < scores[0] <= 1.0
    assert scores[0] > scores[1] + 0.02
    assert scores[0] > scores[2] + 0.3


def test_a_pose_out_of_all_views_scores_nothing(mug):
    model, X_WO, frame = mug
    behind = move(X_WO, np.array([0, 0, 0, 5.0, 0.0, 0.0]))

    assert score_poses(model.aligned, frame, behind[None], 0.008, CONFIG)[0] == 0.0


@pytest.mark.parametrize(
    "motion",
    [
        [0.0, 0.0, 0.6, 0.03, 0.0, 0.02],
        [0.5, 0.0, 0.0, 0.0, 0.03, 0.03],
        [0, -0.4, 0.4, 0, 0, 0.05],
    ],
)
def test_finds_a_mug_that_fell_or_swung(mug, motion):
    model, X_WO, frame = mug
    guess = Guess(move(X_WO, np.array(motion)), np.radians(25.0), 0.03)

    found = search(model, frame, [guess], 1, CONFIG)

    errors = [inverse(X_WO) @ X for X in found]
    # Near enough to be aligned from: of a mug 8 cm wide.
    assert min(np.linalg.norm(X[:3, 3]) for X in errors) < 0.015
    assert min(rotation_angle(X[:3, :3]) for X in errors) < np.radians(15.0)


def test_the_poses_found_are_different_ones(mug):
    model, X_WO, frame = mug

    found = search(model, frame, [Guess(X_WO, 0.4, 0.03)], 2, CONFIG)

    sizes = CONFIG.search
    between = inverse(found[0]) @ found[1]
    assert len(found) == sizes.aligned == 2
    assert (
        np.linalg.norm(between[:3, 3]) >= sizes.distinct_linear
        or rotation_angle(between[:3, :3]) >= sizes.distinct_angular
    )


def test_the_same_draw_finds_the_same(mug):
    model, X_WO, frame = mug
    guesses = [Guess(X_WO, 0.3, 0.02), Guess(move(X_WO, np.full(6, 0.02)), 0.3, 0.02)]

    first, second = (search(model, frame, guesses, 7, CONFIG) for _ in range(2))

    np.testing.assert_array_equal(first, second)
