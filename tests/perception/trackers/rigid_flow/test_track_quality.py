from dataclasses import replace

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.alignment.pose_alignment import PoseEstimate
from poil_drake.perception.trackers.rigid_flow.appearance_model import observe
from poil_drake.perception.trackers.rigid_flow.config import RigidFlowConfig
from poil_drake.perception.trackers.rigid_flow.object_model import build_model
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    Evidence,
    examine,
    is_borne_out,
    is_found,
    part_confidence,
)
from poil_drake.perception.trackers.rigid_flow.view_window import make_window

CONFIG = RigidFlowConfig()
QUALITY = CONFIG.quality
GOOD = Evidence(
    seen=190, other=10, through=2, ahead=8, hidden=60, support=20, edges=0.5, vacant=0.0, enough=120
)


@pytest.fixture(scope="module")
def mug(mug_scene):
    shot = mug_scene.shoot(mug_scene.start)
    model, X_WO = build_model(shot.frame, mug_scene.handle_points, shot.masks, CONFIG)
    return model, PoseEstimate(X_WO, np.eye(6) * 1e-6, np.eye(6) * 1e-6), shot.frame


def examined(mug, X_WO):
    model, _, frame = mug
    points = model.points @ X_WO[:3, :3].T + X_WO[:3, 3]
    views = zip(frame.cameras, frame.images, strict=True)
    windows = [make_window(i, c, im, points, CONFIG.window) for i, (c, im) in enumerate(views)]
    around = observe(model.appearance, frame, X_WO[None, :3, 3], model.radius, CONFIG.appearance)
    return examine(model, windows, around, X_WO, CONFIG), windows


def turned_about_its_axis(mug_scene, X_WO, degrees):
    turn = make_transform(rotation_exp(np.array([0, 0, np.radians(degrees)])), np.zeros(3))
    return mug_scene.start @ turn @ inverse(mug_scene.start) @ X_WO


def test_agreement_weighs_what_is_seen_against_what_is_not():
    # 8 points ahead count as 4.
    assert pytest.approx(190 / 196) == GOOD.agreement


def test_a_good_pose_is_believed(mug):
    model, pose, _ = mug

    assert is_borne_out(GOOD, pose, model, 0.9, QUALITY)
    assert is_found(GOOD, pose, model, QUALITY)


@pytest.mark.parametrize("change", [{"through": 120}, {"vacant": 0.2}])
def test_a_contradicted_pose_is_not(mug, change):
    model, pose, _ = mug

    evidence = replace(GOOD, **change)

    assert not is_borne_out(evidence, pose, model, 0.7, QUALITY)
    assert not is_found(evidence, pose, model, QUALITY)


def test_a_hidden_object_is_not_lost_but_a_lost_one_is_not_found_there(mug):
    model, pose, _ = mug
    hidden = replace(GOOD, seen=0, other=0, through=3, ahead=0, hidden=200, support=0)

    assert is_borne_out(hidden, pose, model, 0.7, QUALITY)
    assert not is_found(hidden, pose, model, QUALITY)


def test_a_few_points_that_agree_are_no_find(mug):
    model, pose, _ = mug
    few = replace(GOOD, seen=40, other=0, through=0, ahead=0, support=6)

    assert not is_found(few, pose, model, QUALITY)


def test_the_true_pose_is_borne_out_by_the_views(mug):
    evidence, _ = examined(mug, mug[1].X_WO)

    assert evidence.agreement > 0.95
    assert evidence.vacant < QUALITY.retry_vacant


def test_a_mug_turned_about_its_axis_is_told_by_its_handle(mug, mug_scene):
    model, pose, _ = mug
    X_WO = turned_about_its_axis(mug_scene, pose.X_WO, -60.0)

    evidence, windows = examined(mug, X_WO)
    confidence = part_confidence(evidence, replace(pose, X_WO=X_WO), model, windows, QUALITY)

    assert evidence.vacant > QUALITY.max_vacant
    assert not is_borne_out(evidence, pose, model, QUALITY.lost_agreement, QUALITY)
    assert confidence.max() < 0.2
