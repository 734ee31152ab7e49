"""After a fall or a swing, the tracker follows, or reports a lost object and finds it again."""

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp
from poil_drake.perception.trackers.rigid_flow.tracker import RigidFlowTracker

STEP = 1 / 8
WRONG = 0.02  # a larger error of a report is wrong [m]


def swung(X_WM, angle, drop=0.0):
    """Returns the mug's pose, dropped and turned about a rod through its handle along y."""
    rod = X_WM @ make_transform(np.eye(3), np.array([0.055, 0.0, 0.06]))
    turn = make_transform(rotation_exp(np.array([0.0, angle, 0.0])), np.array([0.0, 0.0, -drop]))
    return rod @ turn @ inverse(rod) @ X_WM


@pytest.fixture
def lifted(mug_scene):
    """A tracker that has followed the mug in a hand to 15 cm above the table."""
    X_WM = mug_scene.start
    shot = mug_scene.shoot(X_WM, noisy=True)
    dut = RigidFlowTracker()
    output = dut.start(shot.frame, mug_scene.handle_points, shot.masks)
    up = make_transform(np.eye(3), np.array([0.0, 0.0, 0.03]))
    for k in range(1, 6):
        X_WM = up @ X_WM
        frame = mug_scene.shoot(X_WM, time=k * STEP, noisy=True).frame
        output = dut.step(output.state, frame, up)
    return dut, output, X_WM


def test_tracks_a_swing_although_the_motion_prior_is_at_rest(mug_scene, lifted):
    dut, output, start = lifted
    reported = []

    for k in range(12):
        X_WM = swung(start, np.radians(25) * np.sin(2.2 * (k + 1)), drop=0.01)
        frame = mug_scene.shoot(X_WM, time=(6 + k) * STEP, noisy=True).frame
        output = dut.step(output.state, frame, np.eye(4))
        if not output.lost:
            reported.append(mug_scene.errors(output, X_WM).max())

    # Up to 45 degrees between frames; images of half the usual resolution.
    assert len(reported) >= 9
    assert np.median(reported) < 5e-3
    assert np.max(reported) < WRONG


def test_finds_a_fallen_object_within_a_second(mug_scene, lifted):
    dut, output, start = lifted
    # It fell by 6 cm and turned by 40 degrees while no view showed it.
    fallen = swung(make_transform(np.eye(3), np.array([0.02, 0, -0.06])) @ start, np.radians(40))
    for k in range(2):
        frame = mug_scene.shoot(start, time=(6 + k) * STEP, present=False).frame
        output = dut.step(output.state, frame, np.eye(4))
        assert output.lost
    after = []

    for k in range(8):
        frame = mug_scene.shoot(fallen, time=(8 + k) * STEP, noisy=True).frame
        output = dut.step(output.state, frame, np.eye(4))
        after.append(np.inf if output.lost else mug_scene.errors(output, fallen).max())

    found = [error for error in after if np.isfinite(error)]
    assert after[-1] < 5e-3
    assert max(found) < WRONG


def test_an_object_found_far_from_its_prediction_has_to_be_confirmed(mug_scene, lifted):
    dut, output, start = lifted
    fallen = make_transform(np.eye(3), np.array([0.0, 0.02, -0.03])) @ start
    gone = mug_scene.shoot(start, time=6 * STEP, present=False).frame
    output = dut.step(output.state, gone, np.eye(4))

    first = dut.step(output.state, mug_scene.shoot(fallen, time=7 * STEP).frame, np.eye(4))
    second = dut.step(first.state, mug_scene.shoot(fallen, time=8 * STEP).frame, np.eye(4))

    assert first.lost
    assert first.state.unconfirmed
    assert not second.lost
    assert mug_scene.errors(second, fallen).max() < 4e-3


def test_a_mug_without_its_handle_gets_little_confidence(mug_scene, lifted):
    dut, output, start = lifted

    for k in range(4):
        shot = mug_scene.shoot(start, time=(6 + k) * STEP, with_handle=False, noisy=True)
        output = dut.step(output.state, shot.frame)

    assert output.points.confidence.max() < 0.3
