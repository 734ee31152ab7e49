from dataclasses import replace

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import look_around
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    LOST_AGREEMENT,
    MAX_CONFLICT,
    RETRY_CONFLICT,
    Evidence,
    examine,
    part_confidence,
)

GOOD = Evidence(
    seen=190,
    other_color=10,
    seen_through=2,
    in_front=8,
    occluded=60,
    enough=120,
    support=20,
    edges=0.5,
    conflict=0.0,
    deviation=1e-3,
)


def examined(mug, X_WO):
    """Returns the evidence for a pose of the mug in its first frame, and the confidence (N,)."""
    pose = PoseEstimate(X_WO, np.eye(6) * 1e-6, np.eye(6) * 1e-6)
    windows, observed = look_around(mug.model, mug.frame, X_WO)
    evidence = examine(mug.model, windows, observed, pose)
    return evidence, part_confidence(evidence, pose, mug.model, windows)


def test_agreement_compares_seen_points_with_those_against():
    # 8 points in front count as 4.
    assert pytest.approx(190 / 196) == GOOD.agreement


@pytest.mark.parametrize(
    ("change", "accepted", "found"),
    [
        ({}, True, True),
        ({"seen_through": 120}, False, False),
        ({"conflict": 0.2}, False, False),
        ({"deviation": 0.03}, False, False),
        ({"seen": 0, "other_color": 0, "in_front": 0, "occluded": 200, "support": 0}, True, False),
        ({"seen": 40, "other_color": 0, "seen_through": 0, "in_front": 0}, True, False),
    ],
    ids=["good", "seen through", "in conflict", "uncertain", "occluded", "few points"],
)
def test_a_tracked_object_is_accepted_and_a_lost_one_found(change, accepted, found):
    evidence = replace(GOOD, **change)

    assert evidence.supports_pose(LOST_AGREEMENT) == accepted
    assert evidence.is_found == found


def test_the_views_support_the_true_pose(built_mug):
    evidence, _ = examined(built_mug, built_mug.X_WO)

    assert evidence.agreement > 0.95
    assert evidence.conflict < RETRY_CONFLICT


def test_the_handle_contradicts_a_mug_turned_about_its_axis(built_mug, mug_scene):
    turn = make_transform(rotation_exp(np.array([0, 0, np.radians(-60.0)])), np.zeros(3))
    X_WO = mug_scene.start @ turn @ inverse(mug_scene.start) @ built_mug.X_WO

    evidence, confidence = examined(built_mug, X_WO)

    assert evidence.conflict > MAX_CONFLICT
    assert not evidence.supports_pose(LOST_AGREEMENT)
    assert confidence.max() < 0.2
