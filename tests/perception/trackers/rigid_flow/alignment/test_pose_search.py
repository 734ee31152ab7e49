import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, rotation_angle
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import move
from poil_drake.perception.trackers.rigid_flow.alignment.pose_search import (
    SearchRegion,
    score_poses,
    search,
)


def test_the_true_pose_scores_best(built_mug):
    model, X_WO, frame = built_mug
    turned, moved = ([0.0, 0.0, 0.5, 0, 0, 0], [0, 0, 0, 0.0, 0.0, 0.03])
    poses = np.stack([X_WO, move(X_WO, np.array(turned)), move(X_WO, np.array(moved))])

    scores = score_poses(model.aligned, frame, poses, 0.008)

    # Points that only one camera sees reduce the score.
    assert 0.6 < scores[0] <= 1.0
    assert scores[0] > scores[1] + 0.02
    assert scores[0] > scores[2] + 0.3


def test_a_pose_outside_all_views_scores_zero(built_mug):
    model, X_WO, frame = built_mug
    behind = move(X_WO, np.array([0, 0, 0, 5.0, 0.0, 0.0]))

    assert score_poses(model.aligned, frame, behind[None], 0.008)[0] == 0.0


@pytest.mark.parametrize(
    "motion",
    [
        [0.0, 0.0, 0.6, 0.03, 0.0, 0.02],
        [0.5, 0.0, 0.0, 0.0, 0.03, 0.03],
        [0, -0.4, 0.4, 0, 0, 0.05],
    ],
)
def test_finds_a_mug_that_fell_or_swung(built_mug, motion):
    model, X_WO, frame = built_mug
    region = SearchRegion(move(X_WO, np.array(motion)), np.radians(25.0), 0.03)

    found = search(model, frame, [region], 1)

    errors = [inverse(X_WO) @ X for X in found]
    # Close enough to align from, for a mug 8 cm wide.
    assert min(np.linalg.norm(X[:3, 3]) for X in errors) < 0.015
    assert min(rotation_angle(X[:3, :3]) for X in errors) < np.radians(15.0)


def test_the_poses_found_are_distinct(built_mug):
    model, X_WO, frame = built_mug

    first, second = search(model, frame, [SearchRegion(X_WO, 0.4, 0.03)], 2)

    between = inverse(first) @ second
    far, turned = np.linalg.norm(between[:3, 3]), rotation_angle(between[:3, :3])
    assert far >= 0.01 or turned >= np.radians(10.0)


def test_a_seed_reproduces_the_search(built_mug):
    model, X_WO, frame = built_mug
    poses = (X_WO, move(X_WO, np.full(6, 0.02)))
    regions = [SearchRegion(X, 0.3, 0.02) for X in poses]

    first, second = (search(model, frame, regions, 7) for _ in range(2))

    np.testing.assert_array_equal(first, second)
