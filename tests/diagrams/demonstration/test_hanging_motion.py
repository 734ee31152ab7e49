from functools import lru_cache

import cv2
import numpy as np
import pytest
from moved_scene import moved
from pydrake.math import RotationMatrix

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.demonstration_config import (
    DemonstrationMotionConfig,
    HangingMotionConfig,
)
from poil_drake.diagrams.scenario.load import ChooseScenario, default_scenario_file
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform, rotation_angle
from poil_drake.models.mug_family import NAMED_MUGS
from poil_drake.models.mug_shape import handle_center_line

MUGS = {mug.name: mug for mug in NAMED_MUGS}
# The rod rises by 15 degrees.
ROD_DIRECTION = np.array([0.0, -np.cos(np.radians(15)), np.sin(np.radians(15))])


@lru_cache
def scene_of(mug):
    data = f"{{poil: {{demonstration_object: 'package://poil_drake/mugs/{mug}/{mug}.sdf'}}}}"
    return DemonstrationScene(ChooseScenario(data=data), cameras=False)


def motion_in(scene, start=(0.45, -0.13), **kwargs):
    hanging = HangingMotionConfig(start=start, **kwargs)
    config = DemonstrationMotionConfig(hanging=hanging)
    return MakeDemonstrationMotion(scene, config)


@pytest.fixture(scope="module")
def scene():
    return scene_of("mug_demo")


@pytest.fixture(scope="module")
def dut(scene):
    return motion_in(scene)


@pytest.mark.parametrize("mug", sorted(MUGS))
def test_no_mug_ever_intersects_table_or_rack(mug):
    scene = scene_of(mug)
    dut = motion_in(scene)

    distances = [
        scene.distance(dut.pose(t), ".*", fixture, ".*")
        for t in np.arange(0.0, dut.duration, 1 / 16)
        for fixture in ("table", "rack")
    ]

    assert min(distances) >= -0.5e-3


@pytest.mark.parametrize("mug", sorted(MUGS))
def test_the_rod_passes_through_every_handle(mug):
    """The curve that the handle's middle and the wall enclose, viewed along the rod."""
    X_MW = np.linalg.inv(motion_in(scene_of(mug)).pose(100.0))
    base = X_MW[:3, :3] @ [0.55, 0.30, 0.26] + X_MW[:3, 3]
    along = X_MW[:3, :3] @ ROD_DIRECTION

    # Where the rod's axis meets the handle's plane, y = 0 of the mug.
    share = -base[1] / along[1]
    hit = base + share * along
    outline = handle_center_line(MUGS[mug], 60)[:, [0, 2]]

    assert 0.03 < share < 0.11
    inside = cv2.pointPolygonTest(outline.astype(np.float32), hit[[0, 2]].tolist(), True)
    # The rod's radius, the handle's, and 3 mm between them.
    assert inside >= 0.0055 + MUGS[mug].handle_radius + 0.003 - 0.001


def test_it_ends_just_above_the_rod(scene, dut):
    gap = scene.distance(dut.pose(dut.duration), "handle", "rack", "rod")

    assert gap == pytest.approx(0.003, abs=1e-6)


def test_it_ends_tilted_with_the_handle_up_and_away_from_the_robot(dut):
    R = dut.pose(dut.duration)[:3, :3]

    # The opening faces along the rod.
    assert abs(R[:, 1] @ ROD_DIRECTION) == pytest.approx(1.0)
    assert R[0, 0] == pytest.approx(np.cos(np.radians(45)))
    assert R[2, 0] > 0.6
    assert R[2, 2] > 0.6


def test_it_starts_upright_on_the_table(dut):
    np.testing.assert_allclose(
        dut.pose(0.0), [[1, 0, 0, 0.45], [0, 1, 0, -0.13], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-7
    )


def test_by_default_it_starts_where_the_scenarios_own_object_does(scene):
    position = motion_in(scene, start=()).pose(0.0)[:3, 3]

    np.testing.assert_allclose(position, [0.47, -0.12, 0.0], atol=1e-7)


def test_the_height_of_its_start_can_be_given(scene):
    position = motion_in(scene, start=(0.4, 0.0, 0.1)).pose(0.0)[:3, 3]

    np.testing.assert_array_equal(position, [0.4, 0.0, 0.1])


@pytest.mark.parametrize(("height", "yaw"), [(0.75, 0.0), (-0.1, 90.0), (0.4, -150.0)])
def test_it_moves_with_the_whole_scene(scene, height, yaw):
    expected = motion_in(scene, start=())

    elsewhere = DemonstrationScene(moved(ChooseScenario(), height=height, yaw=yaw), cameras=False)
    dut = motion_in(elsewhere, start=())

    X = make_transform(RotationMatrix.MakeZRotation(np.radians(yaw)).matrix(), [0, 0, height])
    for time in (0.0, 2.0, 4.5, 99.0):
        np.testing.assert_allclose(dut.pose(time), X @ expected.pose(time), atol=1e-5)


def test_it_goes_at_a_human_pace_and_rests_at_both_ends(dut):
    step = 1 / 64
    X = np.array([dut.pose(t) for t in np.arange(0.0, dut.duration + step, step)])
    speed = np.linalg.norm(np.diff(X[:, :3, 3], axis=0), axis=1) / step
    turning = rotation_angle(np.swapaxes(X[:-1, :3, :3], -1, -2) @ X[1:, :3, :3]) / step

    assert 6.0 <= dut.duration <= 8.0
    assert speed.max() < 0.25
    assert turning.max() < 1.0
    resting = int(0.25 / step)
    assert speed[:resting].max() == 0.0
    assert speed[-resting:].max() < 1e-9


def test_the_handle_can_start_at_any_angle(scene):
    dut = motion_in(scene, start_yaw=150.0)

    np.testing.assert_allclose(
        dut.pose(0.0)[:3, 0], [np.cos(np.radians(150)), np.sin(np.radians(150)), 0], atol=1e-9
    )
    np.testing.assert_allclose(dut.pose(99.0), motion_in(scene).pose(99.0), atol=1e-9)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"rod": "hook"}, "no link or collision geometry 'hook'"),
        ({"clearance": 0.05}, "gap between rod and handle is .* mm, less than"),
        ({"rod": "stand"}, "'stand' of 'rack' is too steep"),
    ],
)
def test_an_unsuitable_rod_is_refused(scene, values, says):
    with pytest.raises(ScenarioError, match=says):
        motion_in(scene, **values)


def test_an_object_without_a_handle_is_refused():
    # By its path, it is a user's own mug.
    mug = default_scenario_file().parents[1] / "mugs" / "mug_demo" / "mug_demo.sdf"
    scenario = ChooseScenario(
        data=f"{{poil: {{part: rim, parts: {{rim: 'body'}}, demonstration_object: '{mug}'}}}}"
    )

    with pytest.raises(ScenarioError, match="not a handle"):
        motion_in(DemonstrationScene(scenario, cameras=False))
