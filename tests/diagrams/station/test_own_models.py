"""Models as people have them: the base, the part, and what is refused when a station is built."""

import dataclasses
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from own_models import (
    HANDLE,
    PACKAGE_MUG,
    mjcf_file,
    mjcf_mug,
    mjcf_rack,
    own_scenario,
    sdf_file,
    sdf_mug,
    sdf_shape,
    urdf_mug,
)
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator
from scipy.spatial.transform import Rotation
from station_state import SetObjectPose

from poil_drake.diagrams.demonstration.recorder import MakeDemonstrationMotion
from poil_drake.diagrams.demonstration.scene import DemonstrationScene
from poil_drake.diagrams.run.task_success import SimulatedTruth
from poil_drake.diagrams.scenario.load import ChooseScenario, LoadScenario
from poil_drake.diagrams.scenario.model_checks import RequireFreeStart
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.diagrams.station.station import CaptureFrame, MakeStation
from poil_drake.errors import ScenarioError
from poil_drake.geometry.rigid_transform import make_transform

WRAPPER = '<link name="base_link"/>'
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


@pytest.mark.render
@pytest.mark.parametrize("name", ["empty_root_last.urdf", "nested.sdf"])
def test_cameras_see_the_part_of_an_own_mug(name: str, tmp_path: Path) -> None:
    text, base = MUGS[name]
    scenario = scenario_of(text, tmp_path, name, pose_of=base)
    station = MakeStation(scenario, ignore_output_delay=True)

    frame = CaptureFrame(station, station.CreateDefaultContext(), labels=True)

    [handle] = frame.label_ids["mug/handle"]
    seen = [np.count_nonzero(image.label == handle) for image in frame.images]
    # At most the bars' area, 12 mm x 170 mm, at about 0.7 m: some hundred pixels.
    assert max(seen) > 100


def test_the_wrapper_of_a_nested_mug_may_have_a_link(tmp_path: Path) -> None:
    light = "<inertial><mass>0.001</mass><inertia><ixx>1e-7</ixx><iyy>1e-7</iyy><izz>1e-7</izz>"
    wrapper = f'<link name="base_link">{light}</inertia></inertial></link>'
    text = sdf_file(f'<model name="outer">{wrapper}{sdf_mug()}{ON_WRAPPER}</model>')
    scenario = scenario_of(text, tmp_path, "mug.sdf", pose_of="base_link")

    station = MakeStation(scenario, cameras=False)

    assert station.object_body().name() == "base_link"
    assert {"mug", "mug/handle"} <= set(station.label_ids)


def nested_kitchen() -> str:
    """Returns a rack, which is fixed, and a mug as models nested in an SDFormat model."""
    rod = "<capsule><radius>0.0055</radius><length>0.14</length></capsule>"
    post = "<cylinder><radius>0.011</radius><length>0.28</length></cylinder>"
    shapes = sdf_shape("post", (0, 0, 0.14), post)
    shapes += f'<collision name="rod_bar"><pose>0 -0.07 0.27 1.4 0 0</pose><geometry>{rod}'
    shapes += "</geometry></collision>"
    place = "<pose>0.55 0.30 0 0 0 0</pose>"
    rack = f'<model name="stand">{place}<link name="wood">{shapes}</link></model>'
    fixed = '<joint name="f" type="fixed"><parent>world</parent><child>stand::wood</child></joint>'
    cup = sdf_mug().replace('name="cup">', 'name="body"><pose>0.47 -0.12 0 0 0 0</pose>')
    return sdf_file(f'<model name="kitchen">{rack}{fixed}{cup}</model>')


KITCHENS = {
    "welded.xml": mjcf_file(mjcf_rack(), mjcf_mug()),
    "free.xml": mjcf_file(mjcf_rack("<freejoint/>"), mjcf_mug()),
    "nested.sdf": nested_kitchen(),
}


def kitchen_scenario(folder: Path, name: str, poil: str = "") -> Scenario:
    """Returns a scenario in which one file holds mug and rack."""
    (folder / name).write_text(KITCHENS[name])
    kitchen = f"{{add_model: {{name: kitchen, file: '{folder / name}'}}}}"
    names = "object: 'kitchen::body', fixture: 'kitchen::stand'"
    poil = f"{poil or names}, demonstration_motion: {{hanging: {{rod: 'rod_.*'}}}}"
    return ChooseScenario(data=own_scenario(rack="", weld_rack="", more=kitchen, poil=poil))


@pytest.mark.parametrize("name", KITCHENS)
def test_object_and_fixture_may_be_bodies_of_one_model(name: str, tmp_path: Path) -> None:
    scenario = kitchen_scenario(tmp_path, name)

    station = MakeStation(scenario, cameras=False)
    scene = DemonstrationScene(scenario, cameras=False)

    labels = {"table", "panda", "kitchen::body", "kitchen::stand", "kitchen::body/handle"}
    assert set(station.label_ids) == labels
    assert station.object_body().name() == "body"
    # The package's mug is demonstrated in place of the kitchen's.
    motion = MakeDemonstrationMotion(scene, scenario.poil.demonstration_motion)
    gap = scene.distance(motion.pose(motion.duration), "handle", "kitchen::stand", "rod_.*")
    assert gap == pytest.approx(0.003, abs=1e-5)
    assert scene.boxes("kitchen::body", ".*") == []


@pytest.mark.render
@pytest.mark.parametrize("own", [True, False])
def test_a_body_of_a_larger_model_is_demonstrated_under_its_name(own: bool, tmp_path: Path) -> None:
    same = f"demonstration_object: '{tmp_path}/welded.xml', " if own else ""
    names = f"{same}object: 'kitchen::body', fixture: 'kitchen::stand'"
    scene = DemonstrationScene(kitchen_scenario(tmp_path, "welded.xml", names))
    scene.put_object(make_transform(np.eye(3), [0.45, -0.1, 0.0]))

    frame = scene.capture(0.0, labels=True)

    [handle] = frame.label_ids["kitchen::body/handle"]
    assert handle in frame.label_ids["kitchen::body"]
    assert max(np.count_nonzero(image.label == handle) for image in frame.images) > 100
    assert (scene.object_name == "kitchen::body") is own


@pytest.mark.parametrize("name", KITCHENS)
def test_a_body_of_a_larger_model_hangs_on_another(name: str, tmp_path: Path) -> None:
    own = f"demonstration_object: '{tmp_path / name}', "
    names = f"{own}object: 'kitchen::body', fixture: 'kitchen::stand'"
    scenario = kitchen_scenario(tmp_path, name, names)
    motion = MakeDemonstrationMotion(
        DemonstrationScene(scenario, cameras=False), scenario.poil.demonstration_motion
    )
    station = MakeStation(scenario, cameras=False)
    simulator, truth = Simulator(station), SimulatedTruth(station)
    context, step = simulator.get_mutable_context(), scenario.poil.rates.plant

    simulator.AdvanceTo(2 * step)
    truth.observe(context)
    standing = truth.judge.touched_links
    # The motion ends 3 mm above the rod.
    X_WO = RigidTransform(motion.pose(motion.duration))
    X_WO.set_translation(X_WO.translation() - [0.0, 0.0, 0.0045])
    SetObjectPose(station, context, X_WO)
    simulator.AdvanceTo(4 * step)
    truth.observe(context)

    assert standing <= {"table::table"}
    assert truth.judge.last_touched
    assert all(touched.startswith("kitchen::stand::") for touched in truth.judge.last_touched)
    assert truth.judge.hanging_since == 4 * step


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
    text = own_scenario(mug=None, rack=str(file), more=PACKAGE_MUG)
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


@pytest.mark.parametrize(
    ("text", "name", "pose_of", "says"),
    [
        (MUGS["plain.urdf"][0], "a.urdf", "handle", "'handle', .*'mug::body'.*base link 'body'"),
        (MUGS["child_first.sdf"][0], "a.sdf", "handle", "'handle', .*'mug::body'"),
        (MUGS["empty_root.urdf"][0], "a.urdf", "body", "'body', .*'mug::base_link'"),
        (MUGS["nested.sdf"][0], "a.sdf", "cup::handle", "base link 'cup::body'"),
        (MUGS["nested.sdf"][0], "a.sdf", "body", "no such link.*cup::handle, cup::body"),
        (MUGS["mug.xml"][0], "a.xml", "handle", "'handle', .*'mug::body'"),
        (mjcf_file(mjcf_mug(joint="")), "a.xml", "body", "'body', which is welded or joined"),
    ],
)
def test_a_pose_is_given_to_the_base_body(
    text: str, name: str, pose_of: str, says: str, tmp_path: Path
) -> None:
    scenario = scenario_of(text, tmp_path, name, pose_of=pose_of)

    with pytest.raises(ScenarioError, match=f"'mug' has a default_free_body_pose for .*{says}"):
        MakeStation(scenario, cameras=False)


def test_a_pose_may_be_given_in_the_frame_of_another_model(tmp_path: Path) -> None:
    scenario = ChooseScenario()
    mug = next(
        d.add_model for d in scenario.directives if d.add_model and d.add_model.name == "mug"
    )
    pose = mug.default_free_body_pose["body"]
    pose.base_frame = "rack::stand"
    mug.default_free_body_pose = {"body": pose}

    station = MakeStation(scenario, cameras=False)

    X_WO = station.object_body().EvalPoseInWorld(station.plant().CreateDefaultContext())
    # The rack stands at (0.55, 0.30), the mug at (0.47, -0.12) from it.
    np.testing.assert_allclose(X_WO.translation(), [1.02, 0.18, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "name", "says"),
    [
        (urdf_mug(inertial=False), "a.urdf", "mug::body, mug::handle move, but have no mass"),
        (mjcf_file(mjcf_mug(mass='mass="0"')), "a.xml", "mug::body, mug::handle .* no mass"),
        (sdf_file(sdf_mug(inertial=False)), "a.sdf", "mass of 2 kg and moments of inertia of 2 to"),
        (
            urdf_mug().replace("1.5e-4", "0").replace("1.2e-4", "0"),
            "a.urdf",
            "mass of 0.3 kg and moments of inertia of 0 to",
        ),
        (urdf_mug().replace("0.15", "150"), "a.urdf", "mass of 300 kg, but .* at most 3 kg"),
    ],
)
def test_an_object_needs_mass_and_inertia(text: str, name: str, says: str, tmp_path: Path) -> None:
    scenario = scenario_of(text, tmp_path, name)

    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario, cameras=False)


@pytest.mark.parametrize(
    ("pose", "inside"),
    [
        ("{}", "panda::panda_link0"),
        ("{body: {translation: [0.55, 0.30, 0.1]}}", "rack::stand"),
        ("{body: {translation: [0.47, -0.12, -0.03]}}", "table::table"),
        ("{body: {translation: [0.47, -0.12, -0.002]}}", None),
    ],
)
def test_an_object_starts_outside_of_other_models(pose: str, inside: str | None) -> None:
    more = PACKAGE_MUG.replace("{body: {translation: [0.47, -0.12, 0.0]}}", pose)
    station = MakeStation(ChooseScenario(data=own_scenario(more=more)), cameras=False)
    query = station.GetOutputPort("query_object").Eval(station.CreateDefaultContext())

    with (
        pytest.raises(ScenarioError, match=f"'mug' starts .* mm inside '{inside}'")
        if inside
        else nullcontext()
    ):
        RequireFreeStart(station.plant(), query, "mug")


@pytest.mark.parametrize(
    ("text", "name", "pose_of", "says"),
    [
        (
            sdf_file(sdf_mug().split("<joint")[0] + "</model>"),
            "a.sdf",
            "body",
            "falls apart.*body, h",
        ),
        (mjcf_file(mjcf_mug(joint="")), "a.xml", "", "'world', by the joint.*<freejoint/>"),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", "a.xml", "", "without bodies"),
    ],
)
def test_an_object_moves_freely_as_one_piece(
    text: str, name: str, pose_of: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario_of(text, tmp_path, name, pose_of=pose_of), cameras=False)


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (
            "object: 'kitchen::handle', fixture: 'kitchen::stand'",
            "its base 'handle' to 'kitchen::body'",
        ),
        ("object: kitchen, fixture: 'kitchen::stand'", "have bodies in common"),
        ("object: 'kitchen::cup', fixture: 'kitchen::stand'", "'kitchen::cup', but no directive"),
    ],
)
def test_a_body_of_a_larger_model_is_named_with_its_model(
    names: str, says: str, tmp_path: Path
) -> None:
    scenario = kitchen_scenario(tmp_path, "welded.xml", f"{names}, parts: {{handle: '.*'}}")

    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario, cameras=False)


STATIC_RACK = """<model name="rack"><static>true</static><link name="stand"><pose>1 0 0 0 0 0</pose>
<collision name="rod"><geometry><capsule><radius>0.005</radius><length>0.1</length></capsule>
</geometry></collision></link></model>"""


@pytest.mark.parametrize(
    ("text", "name", "place"),
    [
        (mjcf_file(mjcf_rack()), "rack.xml", [0.55, 0.30, 0.0]),
        (sdf_file(STATIC_RACK), "rack.sdf", [1.0, 0.0, 0.0]),
    ],
)
def test_a_rack_that_its_file_welds_is_not_welded_again(
    text: str, name: str, place: list[float], tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_text(text)
    options = {"rack": str(file), "more": PACKAGE_MUG}
    options["poil"] = "demonstration_motion: {hanging: {rod: 'rod.*'}}"

    with pytest.raises(ScenarioError, match=r"needs no add_weld: write its pose into the file"):
        MakeStation(ChooseScenario(data=own_scenario(**options)), cameras=False)

    scenario = ChooseScenario(data=own_scenario(**options, weld_rack=""))
    plant = MakeStation(scenario, cameras=False).plant()
    X_WS = plant.GetBodyByName("stand").EvalPoseInWorld(plant.CreateDefaultContext())
    np.testing.assert_allclose(X_WS.translation(), place, atol=1e-9)


def test_two_welds_of_one_link_are_refused() -> None:
    weld = "{add_weld: {parent: world, child: 'rack::stand'}}"
    scenario = ChooseScenario(data=own_scenario(more=f"{PACKAGE_MUG}, {weld}"))

    with pytest.raises(ScenarioError, match="Weld each link only once"):
        MakeStation(scenario, cameras=False)


def test_welds_that_form_a_loop_are_refused() -> None:
    weld = "{add_weld: {parent: 'table::table', child: 'rack::rod'}}"
    scenario = ChooseScenario(data=own_scenario(more=f"{PACKAGE_MUG}, {weld}"))

    with pytest.raises(ScenarioError, match=r"do not fit together.*Remove a weld"):
        MakeStation(scenario, cameras=False)


def test_a_filter_may_name_bodies_of_several_models() -> None:
    group = "{add_collision_filter_group: {name: loose, members: ['mug::body', 'table::table'], "
    group += "ignored_collision_filter_groups: [loose]}}"
    scenario = ChooseScenario(data=own_scenario(more=f"{PACKAGE_MUG}, {group}"))

    station = MakeStation(scenario, cameras=False)

    plant, inspector = station.plant(), station.scene_graph().model_inspector()
    mug, table = (
        plant.GetCollisionGeometriesForBody(plant.GetBodyByName(name, model))[0]
        for name, model in (
            ("body", plant.GetModelInstanceByName("mug")),
            ("table", plant.GetModelInstanceByName("table")),
        )
    )
    assert inspector.CollisionFiltered(mug, table)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("{add_weld: {parent: 'mug::body', child: world}}", "exchange its parent and child"),
        ("{add_weld: {parent: world, child: 'rak::stand'}}", "'rak'.*below the one that adds"),
        (
            "{add_weld: {parent: world, child: 'mug::body', X_PC: {translation: [.inf, 0, 0]}}}",
            "X_PC",
        ),
        (
            "{add_frame: {name: a, X_PF: {base_frame: world, rotation: !Uniform {}}}}",
            "X_PF of the frame 'a' cannot be used.*no random",
        ),
        (PACKAGE_MUG, "'mug'.*Give each add_model a name"),
        ("{add_model: {name: a, file: a.urdf.xacro}}", "expand a .xacro"),
        ("{add_model: {name: a, file: torn.urdf}}", "torn.urdf.*Correct the XML"),
        ("{add_model: {name: a, file: stl.xml}}", r"a.stl.*Convert the mesh to .obj"),
    ],
)
def test_mistakes_in_directives_are_explained(change: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.urdf.xacro").write_text("<robot/>")
    (tmp_path / "torn.urdf").write_text("<robot name='a'><link")
    weld = "{parent: world, child: 'mug::body', X_PC: {translation: [.inf, 0, 0]}}"
    (tmp_path / "infinite.yaml").write_text(f"directives: [{{add_weld: {weld}}}]")
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    mesh = "<asset><mesh name='a' file='a.stl'/></asset><worldbody><geom type='mesh' mesh='a'/>"
    (tmp_path / "stl.xml").write_text(f"<mujoco>{mesh}</worldbody></mujoco>")
    (tmp_path / "scene.yaml").write_text(f"Own: {own_scenario(more=f'{PACKAGE_MUG}, {change}')}")

    with pytest.raises(ScenarioError, match=says) as info:
        MakeStation(LoadScenario(filename=tmp_path / "scene.yaml"), cameras=False)

    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    ("pose", "says"),
    [
        ("rotation: !Uniform {}", "of 'mug::body' cannot be used.*no random"),
        ("base_frame: shelf", "base_frame of .* of 'mug::body' cannot be used.*'shelf'"),
    ],
)
def test_a_pose_that_cannot_be_used_is_refused(pose: str, says: str) -> None:
    more = PACKAGE_MUG.replace("translation: [0.47, -0.12, 0.0]", pose)
    scenario = ChooseScenario(data=own_scenario(more=more))

    with pytest.raises(ScenarioError, match=says):
        MakeStation(scenario, cameras=False)


def test_directives_of_a_file_may_have_a_namespace(tmp_path: Path) -> None:
    rules = "{add_collision_filter_group: {name: g, members: ['mug::body', 'stand::table'], "
    rules += "ignored_collision_filter_groups: [g]}}"
    table = "{add_model: {name: stand, file: 'package://poil_drake/fixtures/table.sdf'}}"
    weld = "{add_weld: {parent: world, child: 'stand::table', X_PC: {translation: [0, 0, 0.5]}}}"
    file = tmp_path / "corner.dmd.yaml"
    file.write_text(f"directives: [{table}, {weld}, {PACKAGE_MUG}, {rules}]")
    space = "{add_model_instance: {name: lab}}"
    added = f"{{add_directives: {{file: '{file}', model_namespace: lab}}}}"
    data = own_scenario(more=f"{space}, {added}", poil="object: 'lab::mug'")

    station = MakeStation(ChooseScenario(data=data), cameras=False)

    pose = station.object_body().EvalPoseInWorld(station.plant().CreateDefaultContext())
    np.testing.assert_allclose(pose.translation(), [0.47, -0.12, 0.0], atol=1e-9)
    assert {"lab::mug", "lab::mug/handle", "lab"} <= set(station.label_ids)
