"""Bodies of models, for random trees of links in random order."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from poil_drake.diagrams.scenario.model_parts import (
    BaseBody,
    BodiesByModel,
    LinkName,
    ModelBodies,
    RequireFreeObject,
    RequireModels,
)
from poil_drake.errors import ScenarioError

KINDS = ("fixed", "revolute")


@st.composite
def trees(draw: st.DrawFn) -> tuple[dict[int, int], list[int], list[str]]:
    """Returns the parent of each link but link 0, an order of all links, and kinds of joints."""
    count = draw(st.integers(1, 6))
    parents = {link: draw(st.integers(0, link - 1)) for link in range(1, count)}
    order = draw(st.permutations(range(count)))
    kinds = [draw(st.sampled_from(KINDS)) for _ in range(count)]
    return parents, order, kinds


def urdf(parents: dict[int, int], order: list[int], kinds: list[str]) -> str:
    links = "".join(f'<link name="l{link}"/>' for link in order)
    joints = "".join(
        f'<joint name="j{link}" type="{kinds[link]}"><parent link="l{parent}"/>'
        f'<child link="l{link}"/><axis xyz="0 0 1"/><limit effort="1" velocity="1" lower="-1" '
        'upper="1"/></joint>'
        for link, parent in parents.items()
    )
    return f'<robot name="own">{joints}{links}</robot>'


def names(plant: MultibodyPlant, model: str) -> set[str]:
    return {plant.get_body(body).name() for body in ModelBodies(plant, model)}


def ancestors(parents: dict[int, int], link: int) -> set[int]:
    return {link} if link == 0 else {link} | ancestors(parents, parents[link])


@given(trees())
def test_the_base_is_the_root_whatever_the_order(tree) -> None:
    parents, order, _ = tree
    plant = MultibodyPlant(0.01)
    Parser(plant).AddModelsFromString(urdf(*tree), "urdf")
    before = {link: names(plant, f"own::l{link}") for link in order}
    plant.Finalize()

    RequireFreeObject(plant, "own")

    assert BaseBody(plant, "own").name() == "l0"
    assert names(plant, "own") == {f"l{link}" for link in order}
    for link in order:
        carried = {f"l{other}" for other in order if link in ancestors(parents, other)}
        assert before[link] == names(plant, f"own::l{link}") == carried
        assert BaseBody(plant, f"own::l{link}").name() == f"l{link}"


@given(trees(), st.integers(0, 5))
def test_the_base_of_a_fixed_model_is_its_root_too(tree, welded: int) -> None:
    parents, order, kinds = tree
    plant = MultibodyPlant(0.01)
    Parser(plant).AddModelsFromString(urdf(parents, order, kinds), "urdf")
    link = welded % len(order)
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("l0"))
    plant.Finalize()

    assert BaseBody(plant, "own").name() == "l0"
    with pytest.raises(ScenarioError, match=f"its base 'l{link}' to '(world|own::l)"):
        RequireFreeObject(plant, f"own::l{link}")


def two_models() -> MultibodyPlant:
    """Returns a plant with the models "a", "a::b", which is nested, and "ab"."""
    nested = "<model name='b'><link name='inner'/></model>"
    plant = MultibodyPlant(0.01)
    for name, more in (("a", nested), ("ab", "")):
        text = f"<sdf version='1.9'><model name='{name}'><link name='outer'/>{more}</model></sdf>"
        Parser(plant).AddModelsFromString(text, "sdf")
    return plant


def test_nested_models_belong_to_the_outer_one() -> None:
    plant = two_models()

    assert names(plant, "a") == {"outer", "inner"}
    assert names(plant, "a::b") == names(plant, "a::b::inner") == {"inner"}
    assert names(plant, "ab") == {"outer"}
    for nothing in ("", "b", "a::c", "::outer", "a::", "WorldModelInstance", "c::outer"):
        assert ModelBodies(plant, nothing) == []
    [inner] = ModelBodies(plant, "a::b")
    assert LinkName(plant.get_body(inner), "a") == "b::inner"
    assert LinkName(plant.get_body(inner), "a::b") == "inner"


def test_every_body_belongs_to_one_model() -> None:
    plant = two_models()

    found = {
        m: [plant.get_body(b).name() for b in bodies] for m, bodies in BodiesByModel(plant).items()
    }
    assert found == {"a": ["outer", "inner"], "ab": ["outer"]}
    assert set(BodiesByModel(plant, ["a::b"])) == {"a", "a::b", "ab"}
    assert set(BodiesByModel(plant, ["a::outer"])) == {"a::outer", "a", "ab"}


@pytest.mark.parametrize("name", ["world", "a::world"])
def test_the_world_is_no_model(name: str) -> None:
    with pytest.raises(ScenarioError, match=r"no directive adds.*Choose one of: a, ab"):
        RequireModels(two_models(), {"object": name})
