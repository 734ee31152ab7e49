"""A mug that hangs on a rod of its own colour: what stood there from the first is not the mug."""

from typing import NamedTuple

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import (
    inverse,
    make_transform,
    rotation_exp,
    transform_points,
)
from poil_drake.perception.trackers.protocol import TrackerOutput
from poil_drake.perception.trackers.rigid_flow.appearance_model import observe
from poil_drake.perception.trackers.rigid_flow.track_quality import Evidence, examine, is_borne_out
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker
from poil_drake.perception.trackers.rigid_flow.view_window import make_window

STEP = 1 / 8
LIFT = np.array([0.0, 0.0, 0.08])
SLIDE = np.array([0.0, 0.1, 0.0])  # along the rod, onto it
ROD = np.array([[0.047, -0.06, 0.041], [0.055, 0.1, 0.049]])  # in the hung mug's frame, along y


class Hanging(NamedTuple):
    """A mug on its rod, and the tracker that followed it there."""

    dut: RigidFlowTracker
    outputs: list[TrackerOutput]
    boxes: tuple
    X_WM: np.ndarray


@pytest.fixture(scope="module")
def hung(mug_scene):
    """A mug lifted from the table, slid onto the rod and left there."""
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
    return Hanging(dut, outputs, boxes, X_WM)


def seen(mug_scene, X_WM, boxes, k):
    """What the cameras see of mug and rod, both of one grey, in frame k."""
    return mug_scene.shoot(X_WM, time=k * STEP, noisy=True, boxes=boxes, box_grey=mug_scene.grey)


def evidence_at(hung, mug_scene, degrees) -> tuple[Evidence, bool]:
    """Evidence for the hung mug's pose turned about its axis, and whether it bears the pose out."""
    state, config = hung.outputs[-1].state, hung.dut.config
    turn = make_transform(rotation_exp(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))
    X_MO = inverse(mug_scene.start) @ hung.outputs[0].state.pose.X_WO
    X_WO = hung.X_WM @ turn @ X_MO
    frame = seen(mug_scene, hung.X_WM, hung.boxes, 16).frame
    points = transform_points(X_WO, state.model.points)
    views = zip(frame.cameras, frame.images, strict=True)
    windows = [make_window(i, c, im, points, config.window) for i, (c, im) in enumerate(views)]
    around = observe(
        state.model.appearance, frame, X_WO[None, :3, 3], state.model.radius, config.appearance
    )
    evidence = examine(state.model, windows, around, X_WO, config)
    quality = config.quality
    borne_out = is_borne_out(evidence, state.pose, state.model, quality.lost_agreement, quality)
    return evidence, borne_out


def test_a_mug_on_a_rod_of_its_colour_is_followed_and_believed(hung, mug_scene):
    truth = transform_points(hung.X_WM @ inverse(mug_scene.start), mug_scene.handle_points)

    assert not any(output.lost for output in hung.outputs)
    for output in hung.outputs[-6:]:
        assert np.linalg.norm(output.points.positions - truth, axis=1).max() < 3e-3
        assert output.points.confidence.mean() > 0.5


@pytest.mark.parametrize("degrees", [-40.0, 40.0])
def test_a_turned_mug_is_contradicted_by_its_handle_on_the_rod_too(hung, mug_scene, degrees):
    right, right_holds = evidence_at(hung, mug_scene, 0.0)
    turned, turned_holds = evidence_at(hung, mug_scene, degrees)

    assert right_holds
    assert right.vacant < hung.dut.config.quality.retry_vacant
    assert turned.vacant > hung.dut.config.quality.max_vacant
    assert not turned_holds
