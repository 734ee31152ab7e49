"""Errors of depth and pose, put into computed depth images of balls and boxes on a table."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rendered_boards import cameras

from poil_drake.geometry.rigid_transform import make_transform, rotation_exp
from poil_drake.perception.calibration.depth_check import check_depth
from poil_drake.perception.images import CameraModel, MultiViewFrame, RgbdImage

HEIGHT = 0.72
BALLS = [([0.45, -0.05, 0.05], 0.05), ([0.55, 0.12, 0.07], 0.07), ([0.38, 0.15, 0.04], 0.04)]
PILLAR = ([0.3, -0.2], [0.4, -0.12], 0.12)  # Lower and upper corner, and height above the table.
NOISE = 0.0008

Change = Callable[[MultiViewFrame], MultiViewFrame]


def depth_image(camera: CameraModel, *, objects: bool = True, seed: int = 0) -> np.ndarray:
    """Returns the noisy depth of the scene by intersecting rays with its surfaces."""
    v, u = np.mgrid[: camera.height, : camera.width]
    K = camera.K
    rays_C = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
    rays, eye = rays_C @ camera.X_WC[:3, :3].T, camera.X_WC[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0.0, (HEIGHT - eye[2]) / rays[..., 2], np.inf)
        for centre, radius in BALLS if objects else ():
            arm = eye - centre - [0.0, 0.0, HEIGHT]
            a, b, c = (rays**2).sum(-1), rays @ arm, arm @ arm - radius**2
            hit = (-b - np.sqrt(b * b - a * c)) / a
            depth = np.fmin(depth, hit)
        if objects:
            lower = np.array([*PILLAR[0], HEIGHT])
            upper = np.array([*PILLAR[1], HEIGHT + PILLAR[2]])
            slabs = np.stack([(lower - eye) / rays, (upper - eye) / rays])
            enter, leave = slabs.min(axis=0).max(-1), slabs.max(axis=0).min(-1)
            depth = np.where((enter < leave) & (enter > 0.0), np.fmin(depth, enter), depth)
    depth[depth > 2.0] = 0.0
    noise = np.random.default_rng(seed).normal(scale=NOISE, size=depth.shape)
    return np.where(depth > 0.0, depth + noise, 0.0).astype(np.float32)


def frame(*names: str, objects: bool = True) -> MultiViewFrame:
    """Returns true images; the cameras stand around a table at `HEIGHT`."""
    lift = make_transform(np.eye(3), np.array([0.0, 0.0, HEIGHT]))
    models = tuple(replace(model, X_WC=lift @ model.X_WC) for model in cameras(*names))
    rgb = np.zeros((480, 640, 3), np.uint8)
    return MultiViewFrame(
        models,
        tuple(
            RgbdImage(rgb, depth_image(model, objects=objects, seed=k), 0.0)
            for k, model in enumerate(models)
        ),
    )


def measured(view: int, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Returns a change of the valid depth of one camera."""

    def changed(true: MultiViewFrame) -> MultiViewFrame:
        images = list(true.images)
        depth = images[view].depth
        wrong = np.where(depth > 0.0, change(depth), 0.0).astype(np.float32)
        images[view] = replace(images[view], depth=wrong)
        return replace(true, images=tuple(images))

    return changed


def believed(view: int, *, shift: tuple = (0, 0, 0), turn: tuple = (0, 0, 0)) -> Change:
    """Returns a change of the pose of one camera: a shift [m], and a turn about itself [deg]."""

    def changed(true: MultiViewFrame) -> MultiViewFrame:
        models = list(true.cameras)
        X = models[view].X_WC.copy()
        X[:3, :3] = rotation_exp(np.deg2rad(turn)) @ X[:3, :3]
        X[:3, 3] += shift
        models[view] = replace(models[view], X_WC=X)
        return replace(true, cameras=tuple(models))

    return changed


@pytest.fixture(scope="module")
def true() -> MultiViewFrame:
    return frame("left", "right")


def test_true_cameras_have_no_fault(true: MultiViewFrame) -> None:
    dut = check_depth(true, HEIGHT)

    for fit in dut.tables.values():
        assert fit is not None
        assert abs(fit.offset) < 1e-4
        assert fit.deviation < 2e-4
        assert fit.tilt < np.deg2rad(0.02)
        # The noise is along the optical axis, which is inclined by about 45 degrees.
        assert 0.5 * NOISE < fit.rms < NOISE
    pair = dut.pairs["left", "right"]
    assert pair is not None
    assert pair.distance < 2.0 * NOISE
    assert pair.disagreement < 0.001
    assert dut.causes == {}
    assert dut.table_height is None


@pytest.mark.parametrize(
    ("change", "camera", "kind", "value", "tolerance"),
    [
        (measured(0, lambda z: 1.02 * z), "left", "scale", 1 / 1.02, 0.001),
        (measured(1, lambda z: 0.97 * z), "right", "scale", 1 / 0.97, 0.001),
        (measured(0, lambda z: 0.1 * z), "left", "scale", 10.0, 0.05),
        (measured(1, lambda z: 1000.0 * z), "right", "scale", 0.001, 1e-5),
        (measured(1, lambda z: z + 0.015), "right", "bias", -0.015, 0.0005),
        (measured(0, lambda z: z - 0.01), "left", "bias", 0.01, 0.0005),
        (believed(0, shift=(0, 0, 0.012)), "left", "pose", -0.012, 0.0005),
        (believed(1, shift=(0.003, 0, -0.02)), "right", "pose", 0.02, 0.0005),
    ],
)
def test_the_error_of_one_camera_is_told(
    true: MultiViewFrame, change: Change, camera: str, kind: str, value: float, tolerance: float
) -> None:
    dut = check_depth(change(true), HEIGHT)

    (cause,) = dut.causes[camera]
    assert (cause.kind, len(dut.causes)) == (kind, 1)
    assert cause.value == pytest.approx(value, abs=tolerance)
    assert dut.table_height is None


@pytest.mark.parametrize("turn", [(1.5, 0, 0), (0, -1.0, 0)])
def test_a_tilted_camera_has_a_wrong_pose(true: MultiViewFrame, turn: tuple) -> None:
    dut = check_depth(believed(1, turn=turn)(true), HEIGHT)

    assert [cause.kind for cause in dut.causes["right"]] == ["pose"]
    fit = dut.tables["right"]
    assert fit is not None
    assert np.rad2deg(fit.tilt) == pytest.approx(np.abs(turn).max(), abs=0.05)


@pytest.mark.parametrize(
    ("change", "shift"),
    [
        (believed(0, shift=(0.012, 0, 0)), [-0.012, 0, 0]),
        (believed(1, shift=(0, -0.008, 0)), [0, -0.008, 0]),
    ],
)
def test_a_sideways_error_shows_only_between_two_cameras(
    true: MultiViewFrame, change: Change, shift: list
) -> None:
    dut = check_depth(change(true), HEIGHT)

    assert dut.causes == {}
    assert all(fit is not None and fit.deviation < 0.001 for fit in dut.tables.values())
    pair = dut.pairs["left", "right"]
    assert pair is not None
    np.testing.assert_allclose(pair.shift, shift, atol=0.0006)


@pytest.mark.parametrize("shift", [(0.08, 0, 0), (0, -0.3, 0)])
def test_cameras_that_are_far_apart_sideways_do_not_pass(
    true: MultiViewFrame, shift: tuple
) -> None:
    dut = check_depth(believed(0, shift=shift)(true), HEIGHT)

    assert all(fit is not None and fit.ok for fit in dut.tables.values())
    pair = dut.pairs["left", "right"]
    assert pair is not None
    assert not pair.ok


def test_objects_that_only_one_camera_measures_tell_nothing(true: MultiViewFrame) -> None:
    bare = depth_image(true.cameras[1], objects=False, seed=1)

    dut = check_depth(measured(1, lambda z: np.where(z < bare - 0.001, 0.0, z))(true), HEIGHT)

    assert dut.pairs == {("left", "right"): None}


def test_the_same_wrong_scale_of_both_cameras_is_not_a_wrong_table(true: MultiViewFrame) -> None:
    change = measured(0, lambda z: 1.02 * z)(measured(1, lambda z: 1.02 * z)(true))

    dut = check_depth(change, HEIGHT)

    assert dut.table_height is None
    assert {name: c[0].kind for name, c in dut.causes.items()} == {
        "left": "scale",
        "right": "scale",
    }


def test_a_wrong_height_of_the_table_is_not_blamed_on_the_cameras(true: MultiViewFrame) -> None:
    dut = check_depth(true, HEIGHT + 0.012)

    assert dut.table_height == pytest.approx(HEIGHT, abs=2e-4)
    assert dut.causes == {}


def test_tables_that_are_tilted_apart_are_not_one_table_at_another_height() -> None:
    bare = frame("left", "right", objects=False)
    tilted = believed(0, turn=(1.0, 0, 0))(believed(1, turn=(-1.0, 0, 0))(bare))

    dut = check_depth(tilted, HEIGHT)

    assert dut.table_height is None
    assert {name: cause.kind for name, (cause,) in dut.causes.items()} == {
        "left": "pose",
        "right": "pose",
    }


@pytest.mark.parametrize("names", [("left",), ("left", "right")])
def test_a_table_that_is_far_off_is_not_blamed_on_depth(names: tuple[str, ...]) -> None:
    # With two cameras, the second one does not confirm the height.
    changed = believed(len(names) - 1, shift=(0, 0, 0.006))(frame(*names))

    dut = check_depth(changed, 0.0)

    assert dut.table_height is None
    assert {cause.kind for causes in dut.causes.values() for cause in causes} == {"pose"}
    assert set(dut.causes) == set(names)


def test_without_objects_scale_and_height_cannot_be_told_apart() -> None:
    bare = measured(0, lambda z: 1.02 * z)(frame("left", "right", objects=False))

    dut = check_depth(bare, HEIGHT)

    assert dut.pairs == {("left", "right"): None}
    assert {cause.kind for cause in dut.causes["left"]} >= {"scale", "pose"}


def test_a_camera_that_does_not_see_the_table_has_none(true: MultiViewFrame) -> None:
    up = believed(0, turn=(0, 60, 0))(measured(0, lambda z: 0.0 * z)(true))

    dut = check_depth(up, HEIGHT)

    assert dut.tables["left"] is None
    assert dut.pairs["left", "right"] is None
