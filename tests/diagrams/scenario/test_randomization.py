import numpy as np
import pytest
from pydrake.common.schema import Transform

from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.randomization import ApplyRandomization, ObjectDirective
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError

NO_RANGES = "poil: {randomization: {models: [], x: [], y: [], yaw: []}}"


def draw(scenario: Scenario, seed: int) -> tuple[str, Transform]:
    model = ObjectDirective(list(ApplyRandomization(scenario, seed).directives), "mug")
    return model.file, model.default_free_body_pose["body"]


def test_draws_cover_their_ranges(scenario: Scenario) -> None:
    draws = [draw(scenario, seed) for seed in range(200)]

    files = {file for file, _ in draws}
    positions = np.array([pose.translation for _, pose in draws])
    assert files == set(scenario.poil.randomization.models)
    np.testing.assert_allclose(positions.min(axis=0), [0.38, -0.25, 0], atol=0.01)
    np.testing.assert_allclose(positions.max(axis=0), [0.55, 0.0, 0], atol=0.01)
    for _, pose in draws:
        up = pose.GetDeterministicValue().rotation().matrix()[2]
        np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)


def test_a_seed_always_draws_the_same_trial(scenario: Scenario) -> None:
    first, again = ApplyRandomization(scenario, 3), ApplyRandomization(scenario, 3)

    np.testing.assert_array_equal(
        draw(scenario, 3)[1].translation, draw(scenario, 3)[1].translation
    )
    assert first.random_seed == again.random_seed
    assert first.random_seed != ApplyRandomization(scenario, 4).random_seed


def test_the_given_scenario_does_not_change(scenario: Scenario) -> None:
    before = ObjectDirective(list(scenario.directives), "mug").file

    drawn = {draw(scenario, seed)[0] for seed in range(20)}

    assert len(drawn) > 1
    assert ObjectDirective(list(scenario.directives), "mug").file == before


def test_without_ranges_only_the_noise_changes() -> None:
    fixed = ChooseScenario(data=f"{{{NO_RANGES}}}")

    file, pose = draw(fixed, 1)

    model = ObjectDirective(list(fixed.directives), "mug")
    given = model.default_free_body_pose["body"]
    assert file == model.file
    np.testing.assert_allclose(
        pose.GetDeterministicValue().GetAsMatrix4(), given.GetDeterministicValue().GetAsMatrix4()
    )


@pytest.mark.parametrize("directives", ["[]", "[{add_directives: {file: all.yaml}}]"])
def test_a_seed_without_ranges_needs_no_pose(scenario: Scenario, directives: str) -> None:
    fixed = ChooseScenario(data=f"{{directives: {directives}, {NO_RANGES}}}")

    dut = ApplyRandomization(fixed, 1)

    assert len(dut.directives) == len(fixed.directives)
    assert dut.random_seed == ApplyRandomization(scenario, 1).random_seed


def test_a_random_model_needs_no_pose() -> None:
    text = (
        "{poil: {randomization: {models: ['package://a/b.sdf'], x: [], y: [], yaw: []}},"
        "directives: [{add_model: {name: mug, file: 'package://a/a.sdf'}}]}"
    )

    dut = ApplyRandomization(ChooseScenario(data=text), 1)

    assert dut.directives[0].add_model.file == "package://a/b.sdf"


@pytest.mark.parametrize(
    ("name", "pose", "says"),
    [
        ("teapot", "{}", r"'mug'.*Set poil.object to one of: teapot"),
        ("mug", "{}", "'mug' has 0 default poses.*remove the ranges"),
        ("mug", "{body: {translation: [0, 0, 0]}, lid: {}}", "has 2 default poses"),
        (
            "mug",
            "{body: {translation: !UniformVector {min: [0, 0, 0], max: [1, 1, 0]}}}",
            "'mug' has a random default pose",
        ),
    ],
)
def test_ranges_need_an_object_with_one_deterministic_pose(name: str, pose: str, says: str) -> None:
    model = f"{{name: {name}, file: 'package://a/a.sdf', default_free_body_pose: {pose}}}"
    text = f"directives: [{{add_model: {model}}}]"

    with pytest.raises(ScenarioError, match=says):
        ApplyRandomization(ChooseScenario(data=text), 1)


KITCHEN = """
directives:
- add_model:
    name: kitchen
    file: package://a/kitchen.xml
    default_free_body_pose: {rack: {translation: [0, 1, 0]}, cup: {translation: [2, 0, 0.1]}}
"""


def test_only_the_object_of_a_larger_model_moves() -> None:
    poil = "poil: {object: 'kitchen::cup', randomization: {models: [], x: [0.5, 0.5], y: []}}"
    scenario = ChooseScenario(data=f"{KITCHEN}\n{poil}")

    [directive] = ApplyRandomization(scenario, 1).directives

    poses = directive.add_model.default_free_body_pose
    np.testing.assert_allclose(poses["rack"].translation, [0.0, 1.0, 0.0])
    np.testing.assert_allclose(poses["cup"].translation[[0, 2]], [0.5, 0.1])


def test_the_file_of_a_larger_model_is_not_replaced() -> None:
    poil = "poil: {object: 'kitchen::cup', randomization: {models: ['package://a/mug.sdf']}}"

    with pytest.raises(ScenarioError, match=r"cannot replace 'kitchen::cup'.*model 'kitchen'"):
        ApplyRandomization(ChooseScenario(data=f"{KITCHEN}\n{poil}"), 1)
