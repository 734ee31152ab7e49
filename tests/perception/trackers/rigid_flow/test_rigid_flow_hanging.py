"""A mug that hangs on a rod of its own colour, which the first frame shows as background."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.alignment.pose_location import look_around
from poil_drake.perception.trackers.rigid_flow.track_quality import (
    LOST_AGREEMENT,
    MAX_CONFLICT,
    RETRY_CONFLICT,
    examine,
)
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

STEP = 1 / 8
LIFT = np.array([0.0, 0.0, 0.08])
SLIDE = np.array([0.0, 0.1, 0.0])  # along the rod, onto it
ROD = np.array([[0.047, -0.06, 0.041], [0.055, 0.1, 0.049]])  # in the hung mug's frame, along y


class Hanging(NamedTuple):
    """A mug on its rod, and the outputs of the tracker that followed it there."""

    outputs: list[TrackerOutput]
    boxes: tuple
    X_WM: np.ndarray


@pytest.fixture(scope="module")
def hung(mug_scene):
    """A mug that was lifted from the table, slid onto the rod and left there."""
    X_WM = mug_scene.start @ make_transform(np.eye(3), LIFT + SLIDE)
    boxes = ((ROD, X_WM),)
    shot = mug_scene.shoot(mug_scene.start, noisy=True, boxes=boxes, box_grey=mug_scene.grey)
    dut = RigidFlowTracker()
    outputs = [dut.start(shot.frame, mug_scene.handle_points, shot.masks)]
    for k in range(1, 16):
        way = LIFT * min(k / 4, 1.0) + SLIDE * np.clip((k - 4) / 5, 0.0, 1.0)
        X_k = mug_scene.start @ make_transform(np.eye(3), way)
        frame = seen(mug_scene, X_k, boxes, k).frame
        outputs.append(dut.step(outputs[-1].state, frame))
    return Hanging(outputs, boxes, X_WM)


def seen(mug_scene, X_WM, boxes, k):
    """Returns frame k of the mug and the rod, both of one grey."""
    return mug_scene.shoot(X_WM, time=k * STEP, noisy=True, boxes=boxes, box_grey=mug_scene.grey)


def evidence_at(hung, mug_scene, degrees):
    """Returns the evidence for the hung mug turned about its axis."""
    state = hung.outputs[-1].state
    turn = make_transform(rotation_exp(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))
    X_MO = inverse(mug_scene.start) @ hung.outputs[0].state.pose.X_WO
    pose = replace(state.pose, X_WO=hung.X_WM @ turn @ X_MO)
    frame = seen(mug_scene, hung.X_WM, hung.boxes, 16).frame
    return examine(state.model, *look_around(state.model, frame, pose.X_WO), pose)


def test_a_mug_on_a_rod_of_its_colour_is_tracked(hung, mug_scene):
    assert not any(output.lost for output in hung.outputs)
    for output in hung.outputs[-6:]:
        assert mug_scene.errors(output, hung.X_WM).max() < 3e-3
        assert output.points.confidence.mean() > 0.5


@pytest.mark.parametrize("degrees", [-40.0, 40.0])
def test_the_handle_contradicts_a_turned_pose_on_the_rod_too(hung, mug_scene, degrees):
    true, turned = (evidence_at(hung, mug_scene, angle) for angle in (0.0, degrees))

    assert true.supports_pose(LOST_AGREEMENT)
    assert true.conflict < RETRY_CONFLICT
    assert turned.conflict > MAX_CONFLICT
    assert not turned.supports_pose(LOST_AGREEMENT)
