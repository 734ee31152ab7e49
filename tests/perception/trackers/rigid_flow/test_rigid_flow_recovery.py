"""After a fall or a swing, the tracker follows, or reports a lost object and finds it again."""

import numpy as np
import pytest

from poil_drake.geometry.rigid_transform import inverse, make_transform, rotation_exp

WRONG = 0.02  # a larger error of a report is wrong [m]


def swung(X_WM, angle, drop=0.0):
    """Returns the mug's pose, dropped and turned about a rod through its handle along y."""
    rod = X_WM @ make_transform(np.eye(3), np.array([0.055, 0.0, 0.06]))
    turn = make_transform(rotation_exp(np.array([0.0, angle, 0.0])), np.array([0.0, 0.0, -drop]))
    return rod @ turn @ inverse(rod) @ X_WM


@pytest.fixture
def lifted(tracked, mug_scene):
    """A mug that a hand has lifted by 15 cm while it was tracked, and its pose."""
    X_WM, mug = mug_scene.start, tracked(noisy=True)
    up = make_transform(np.eye(3), np.array([0.0, 0.0, 0.03]))
    for _ in range(5):
        X_WM = up @ X_WM
        mug.step(X_WM, up)
    return mug, X_WM


def test_tracks_a_swing_although_the_motion_prior_is_at_rest(mug_scene, lifted):
    mug, start = lifted
    reported = []

    for k in range(12):
        X_WM = swung(start, np.radians(25) * np.sin(2.2 * (k + 1)), drop=0.01)
        output = mug.step(X_WM, np.eye(4))
        if not output.lost:
            reported.append(mug_scene.error(output, X_WM))

    # Up to 45 degrees between frames; images of half the usual resolution.
    assert len(reported) >= 9
    assert np.median(reported) < 5e-3
    assert np.max(reported) < WRONG


def test_finds_a_fallen_object_within_a_second(mug_scene, lifted):
    mug, start = lifted
    # It fell by 6 cm and turned by 40 degrees while no view showed it.
    fallen = swung(make_transform(np.eye(3), np.array([0.02, 0, -0.06])) @ start, np.radians(40))
    for _ in range(2):
        assert mug.step(start, np.eye(4), present=False).lost

    outputs = [mug.step(fallen, np.eye(4)) for _ in range(8)]

    found = [mug_scene.error(output, fallen) for output in outputs if not output.lost]
    assert not outputs[-1].lost
    assert found[-1] < 5e-3
    assert max(found) < WRONG


def test_an_object_found_far_from_its_prediction_has_to_be_confirmed(mug_scene, lifted):
    mug, start = lifted
    fallen = make_transform(np.eye(3), np.array([0.0, 0.02, -0.03])) @ start
    mug.step(start, np.eye(4), present=False)

    first, second = (mug.step(fallen, np.eye(4), noisy=False) for _ in range(2))

    assert first.lost
    assert first.state.unconfirmed
    assert not second.lost
    assert mug_scene.error(second, fallen) < 4e-3


def test_a_mug_without_its_handle_gets_little_confidence(lifted):
    mug, start = lifted

    for _ in range(4):
        output = mug.step(start, with_handle=False)

    assert output.points.confidence.max() < 0.3
