"""A mug that hangs on a rod of the same colour, which the first frame shows as background."""

from dataclasses import replace

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import look_around
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    LOST_AGREEMENT,
    MAX_CONFLICT,
    RETRY_CONFLICT,
    examine,
)

LIFT = np.array([0.0, 0.0, 0.08])
SLIDE = np.array([0.0, 0.1, 0.0])  # along the rod, onto it
ROD = np.array([[0.047, -0.06, 0.041], [0.055, 0.1, 0.049]])  # in the hung mug's frame, along y


@pytest.fixture(scope="module")
def hung(tracked, mug_scene):
    """A mug that was lifted and slid onto the rod, the outputs on its way, and its pose."""
    X_WM = mug_scene.start @ make_transform(np.eye(3), LIFT + SLIDE)
    mug = tracked(noisy=True, boxes=((ROD, X_WM),), box_grey=mug_scene.grey)
    outputs = [mug.output]
    for k in range(1, 16):
        way = LIFT * min(k / 4, 1.0) + SLIDE * np.clip((k - 4) / 5, 0.0, 1.0)
        outputs.append(mug.step(mug_scene.start @ make_transform(np.eye(3), way)))
    return mug, outputs, X_WM


def evidence_at(hung, mug_scene, degrees):
    """Returns the evidence for the hung mug turned about its axis."""
    mug, outputs, X_WM = hung
    state = mug.output.state
    turn = make_transform(rotation_exp(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))
    X_MO = inverse(mug_scene.start) @ outputs[0].state.pose.X_WO
    pose = replace(state.pose, X_WO=X_WM @ turn @ X_MO)
    return examine(state.model, *look_around(state.model, mug.frame(X_WM), pose.X_WO), pose)


def test_a_mug_on_a_rod_of_its_colour_is_tracked(hung, mug_scene):
    _, outputs, X_WM = hung

    assert not any(output.lost for output in outputs)
    for output in outputs[-6:]:
        assert mug_scene.error(output, X_WM) < 3e-3
        assert output.points.confidence.mean() > 0.5


@pytest.mark.parametrize("degrees", [-40.0, 40.0])
def test_the_handle_contradicts_a_turned_pose_on_the_rod_too(hung, mug_scene, degrees):
    true, turned = (evidence_at(hung, mug_scene, angle) for angle in (0.0, degrees))

    assert true.supports_pose(LOST_AGREEMENT)
    assert true.conflict < RETRY_CONFLICT
    assert turned.conflict > MAX_CONFLICT
    assert not turned.supports_pose(LOST_AGREEMENT)
