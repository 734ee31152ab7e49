"""Models as people have them: the base, the part, and what is refused when a station is built."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from own_models import (
    HANDLE,
    add_mug,
    mjcf_file,
    mjcf_mug,
    own_scenario,
    sdf_file,
    sdf_mug,
    urdf_mug,
)
from scipy.spatial.transform import Rotation

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import MakeStation
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

LIGHT = "<inertial><mass>0.001</mass><inertia><ixx>1e-7</ixx><iyy>1e-7</iyy><izz>1e-7</izz>"
WRAPPER = f'<link name="base_link">{LIGHT}</inertia></inertial></link>{sdf_mug()}'
ON_WRAPPER = (
    '<joint name="on" type="fixed"><parent>base_link</parent><child>cup::body</child></joint>'
)

MUGS = {
    "plain.urdf": (urdf_mug(), "body"),
    "child_first.urdf": (urdf_mug("handle body"), "body"),
    "empty_root.urdf": (urdf_mug("base_link body handle", root="base_link"), "base_link"),
    "empty_root_last.urdf": (urdf_mug("handle body base_link", root="base_link"), "base_link"),
    "child_first.sdf": (sdf_file(sdf_mug("handle body")), "body"),
    "nested.sdf": (sdf_file(f'<model name="outer">{sdf_mug("handle body")}</model>'), "cup::body"),
    "wrapped.sdf": (sdf_file(f'<model name="outer">{WRAPPER}{ON_WRAPPER}</model>'), "base_link"),
    "mug.xml": (mjcf_file(mjcf_mug()), "body"),
}


def scenario_of(text: str, tmp_path: Path, name: str, **options: str) -> Scenario:
    """Returns a scenario with the mug in `text`, which is written to the file `name`."""
    file = tmp_path / name
    file.write_text(text)
    return ChooseScenario(data=own_scenario(mug=file, **options))


def bars_in_object_frame(scene: DemonstrationScene, X_WO: np.ndarray) -> np.ndarray:
    """Returns the centres (3, 3) of the part's geometries, sorted by height."""
    scene.put_object(X_WO)
    centers = np.array([X_WB[:3, 3] for X_WB, _ in scene.boxes(scene.object_name, "handle")])
    return sorted_rows((centers - X_WO[:3, 3]) @ X_WO[:3, :3])


def sorted_rows(points: np.ndarray) -> np.ndarray:
    return points[np.argsort(points[:, 2])]


BARS = sorted_rows(np.array([center for _, center, _ in HANDLE]))


@pytest.mark.parametrize("name", MUGS)
def test_the_base_and_the_part_are_found_in_every_structure(name: str, tmp_path: Path) -> None:
    text, base = MUGS[name]
    scenario = scenario_of(text, tmp_path, name, pose_of=base)

    station = MakeStation(scenario, cameras=False)
    scene = DemonstrationScene(scenario, cameras=False)

    pose = station.object_body().EvalPoseInWorld(station.plant().CreateDefaultContext())
    assert station.object_body().name() == base.rpartition("::")[2]
    np.testing.assert_allclose(pose.translation(), [0.47, -0.12, 0.0], atol=1e-9)
    assert set(station.label_ids) == {"table", "panda", "rack", "mug", "mug/handle"}
    # The part follows the pose given to the object, and has an opening that fits the rod.
    X_WO = make_transform(Rotation.from_rotvec([0.2, -0.4, 1.0]).as_matrix(), [0.4, 0.1, 0.3])
    np.testing.assert_allclose(bars_in_object_frame(scene, X_WO), BARS, atol=1e-6)
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    gap = scene.distance(motion.pose(motion.duration), "handle", "rack", "rod")
    assert gap == pytest.approx(0.003, abs=1e-5)


HINGED_RACK = """<robot name="rack">
<link name="stand"><collision name="post"><geometry><box size="0.05 0.05 0.3"/></geometry>
</collision></link><link name="rod"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
<collision name="bar"><geometry><capsule radius="0.005" length="0.14"/></geometry></collision>
</link>
<joint name="hinge" type="revolute"><parent link="stand"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="0.5" upper="1.0" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize(
    ("set_by", "starts_at"),
    [
        ("nothing", "0 rad"),
        ("initial_position: {rack: {hinge: [45]}}", "45 rad"),
        ("default_joint_positions: {hinge: [-0.7]}", "-0.7 rad"),
    ],
)
def test_a_start_beyond_limits_is_refused_whatever_sets_it(
    set_by: str, starts_at: str, tmp_path: Path
) -> None:
    file = tmp_path / "rack.urdf"
    file.write_text(HINGED_RACK)
    text = own_scenario(rack=file)
    if set_by.startswith("default"):
        text = text.replace(f"file: '{file}'", f"file: '{file}', {set_by}")
    scenario = ChooseScenario(data=text)
    if set_by.startswith("initial"):
        scenario = LoadScenario(data=f"{{{set_by}}}", defaults=scenario)
    says = f"'hinge' of 'rack' starts at {starts_at}, beyond its limits 0.5 and 1 rad.*"

    for make in (
        lambda: MakeStation(scenario, cameras=False),
        lambda: DemonstrationScene(scenario),
    ):
        with pytest.raises(ScenarioError, match=f"{says}initial_position.rack.hinge.*default_join"):
            make()


def test_the_arm_needs_a_start_within_its_limits() -> None:
    scenario = dataclasses.replace(ChooseScenario(), initial_position={})

    # The elbow, joint 4, cannot be straight.
    with pytest.raises(ScenarioError, match=r"'panda_joint4' of 'panda' starts at 0 rad"):
        MakeStation(scenario, cameras=False)


LOOSE = sdf_mug().split("<joint")[0] + "</model>"
WITHOUT_INERTIA = urdf_mug().replace("1.5e-4", "0").replace("1.2e-4", "0")
IN_GRAMS = urdf_mug().replace("0.15", "150").replace("1.5e-4", "0.15").replace("1.2e-4", "0.12")
GIVEN = "'mug' has a default_free_body_pose for '"


@pytest.mark.parametrize(
    ("text", "name", "pose_of", "says"),
    [
        # A pose is that of the base.
        (MUGS["plain.urdf"][0], "a.urdf", "handle", f"{GIVEN}handle', .*'mug::body'.*link 'body'"),
        (MUGS["child_first.sdf"][0], "a.sdf", "handle", f"{GIVEN}handle', .*'mug::body'"),
        (MUGS["empty_root.urdf"][0], "a.urdf", "body", f"{GIVEN}body', .*'mug::base_link'"),
        (MUGS["nested.sdf"][0], "a.sdf", "cup::handle", f"{GIVEN}.*base link 'cup::body'"),
        (MUGS["nested.sdf"][0], "a.sdf", "body", f"{GIVEN}.*no such link.*cup::handle, cup::body"),
        (MUGS["mug.xml"][0], "a.xml", "handle", f"{GIVEN}handle', .*'mug::body'"),
        (
            mjcf_file(mjcf_mug(joint="")),
            "a.xml",
            "body",
            f"{GIVEN}body', which is welded",
        ),
        # Mass and inertia.
        (urdf_mug(inertial=False), "a.urdf", "body", "mug::body, mug::handle move, but have no m"),
        (
            mjcf_file(mjcf_mug(mass='mass="0"')),
            "a.xml",
            "body",
            "mug::handle move, .* no mass",
        ),
        (
            sdf_file(sdf_mug(inertial=False)),
            "a.sdf",
            "body",
            "of 2 kg at .* of inertia of 2 to",
        ),
        (WITHOUT_INERTIA, "a.urdf", "body", "0.3 kg at .* and moments of inertia of 0 to"),
        (IN_GRAMS, "a.urdf", "body", "a mass of 300 kg; a Panda carries 3 kg. .*in kilograms"),
        (urdf_mug().replace('"0.15"', '"0"'), "a.urdf", "body", "of 'mug::body' is impossible"),
        (urdf_mug().replace('"0.15"', '"-0.15"'), "a.urdf", "body", "ball of 1 kg.* positive mass"),
        (urdf_mug().replace("0.045", "45", 1), "a.urdf", "body", r"at \[0.0, 0.0, 22.*metres"),
        # A free body in one piece.
        (sdf_file(LOOSE), "a.sdf", "body", "falls apart.*body, h"),
        (mjcf_file(mjcf_mug(joint="")), "a.xml", "", "'world', by the joint.*<freejoint/>"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "a.xml", "", "without bodies"),
    ],
)
def test_a_model_that_cannot_be_the_object_is_refused(
    text: str, name: str, pose_of: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario_of(text, tmp_path, name, pose_of=pose_of), cameras=False)


def test_a_pose_may_be_given_in_the_frame_of_another_model() -> None:
    mug = add_mug(pose="base_frame: rack::stand, translation: [0.47, -0.12, 0.0]")

    station = MakeStation(ChooseScenario(data=own_scenario(mug="", more=mug)), cameras=False)

    X_WO = station.object_body().EvalPoseInWorld(station.plant().CreateDefaultContext())
    # The rack stands at (0.55, 0.30), the mug at (0.47, -0.12) from it.
    np.testing.assert_allclose(X_WO.translation(), [1.02, 0.18, 0.0], atol=1e-9)
