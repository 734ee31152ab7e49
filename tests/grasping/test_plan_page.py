import base64
import re

import numpy as np
import pytest
import umsgpack
from numpy.testing import assert_allclose

from poil_drake.grasping.plan_page import write_plan_page
from poil_drake.grasping.planner import PlanningResult

X_WB = np.diag([-1.0, -1.0, 1.0, 1.0])  # Turned, so that a missing base pose would show.


@pytest.fixture(scope="module")
def page(planned: PlanningResult, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "plan.html"
    write_plan_page(path, planned, X_WB=X_WB)
    return path.read_text()


@pytest.fixture(scope="module")
def commands(page: str) -> dict[tuple[str, str], dict]:
    """The page's commands to the viewer, by type and path."""
    listed = page.rpartition("const command of")[2]
    found = [umsgpack.unpackb(base64.b64decode(c)) for c in re.findall("'(.+?)'", listed)]
    return {(c["type"], c["path"].removeprefix("/meshcat/")): c for c in found}


def drawn_points(commands, path: str) -> np.ndarray:
    geometry = commands["set_object", path]["object"]["geometries"][0]
    return np.frombuffer(geometry["data"]["attributes"]["position"]["array"].data, np.float32)


def first_and_last_position(commands, path: str) -> np.ndarray:
    """Returns the first and the last animated position (2, 3) [m]."""
    clips = {a["path"]: a["clip"] for a in commands["set_animation", ""]["animations"]}
    tracks = {t["name"]: t["keys"] for t in clips[f"/meshcat/{path}"]["tracks"]}
    return np.array([tracks[".position"][k]["value"] for k in (0, -1)])


def test_clouds_points_and_reference_are_drawn(commands, planned):
    plan, positions = planned.plan, planned.plan.reference.positions
    for path, points in (
        ("obstacles", planned.scene_points),
        ("object/cloud", plan.object_points),
        ("object/functional_points", plan.target_points),
        ("goal", positions[-1]),
        ("reference", np.stack([positions[:-1], positions[1:]], axis=2)),
    ):
        assert_allclose(drawn_points(commands, path), points.ravel(), atol=1e-6)


def test_grasps_are_drawn_by_group(commands, planned):
    # Four segments for each grasp; the last but one point is behind the hand.
    for group, grasps in (
        ("chosen", [planned.plan.grasp]),
        ("feasible", [g for g in planned.feasible if g is not planned.plan.grasp]),
        ("rejected", planned.rejected),
    ):
        lines = drawn_points(commands, f"grasps/{group}").reshape(-1, 8, 3)
        assert len(lines) == len(grasps)
        for line, grasp in zip(lines, grasps, strict=True):
            back = grasp.X_WG[:3, 3] - 0.08 * grasp.X_WG[:3, 2]
            assert np.linalg.norm(line - back, axis=1).min() < 1e-6


def test_robot_and_object_move_from_home_to_the_goal(commands, planned, model, home):
    robot = commands["set_transform", "robot"]["matrix"]
    assert_allclose(np.reshape(robot, (4, 4)).T, X_WB)
    hand = first_and_last_position(commands, "robot/visuals/panda_hand_0")
    # The gripper frame is 0.1034 m in front of the hand's.
    for position, q in zip(hand, (home, planned.choice.feasibility.q_retreat[-1]), strict=True):
        X_WG = model.gripper_pose(q)
        assert_allclose(position, X_WG[:3, 3] - 0.1034 * X_WG[:3, 2], atol=1e-6)
    moved = first_and_last_position(commands, "object")
    assert_allclose(moved, [np.zeros(3), planned.choice.path.X_W[-1, :3, 3]], atol=1e-9)


def test_the_page_is_self_contained(page):
    assert "<title>Plan: mug, handle</title>" in page
    assert "MeshCat.Viewer" in page
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=", page)


def test_writing_starts_no_process_and_prints_nothing(planned, tmp_path, capfd, monkeypatch):
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("A process was started."))

    write_plan_page(tmp_path / "new" / "plan.html", planned, X_WB=X_WB)

    assert capfd.readouterr() == ("", "")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["plan.html"]
