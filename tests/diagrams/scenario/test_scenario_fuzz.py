"""Random values anywhere in a scenario: each is used as it is written, or refused."""

from collections.abc import Iterator
from typing import Any

import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from poil_drake.diagrams.scenario.load import ChooseScenario, DumpScenario, LoadScenario
from poil_drake.errors import ScenarioError

SHIPPED = ChooseScenario()


class Tagged(dict):
    """A mapping with a YAML tag, under the key "_tag"."""


def plain(text: str) -> Any:
    """Returns YAML as mappings, lists and scalars; a tag becomes the key "_tag"."""

    class Loader(yaml.CSafeLoader):
        pass

    Loader.add_multi_constructor(
        "!", lambda loader, tag, node: Tagged({"_tag": tag, **loader.construct_mapping(node, True)})
    )
    return yaml.load(text, Loader)


def leaves(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yields the paths of all values of mappings within mappings."""
    for key, value in node.items():
        yield (*path, key)
        if isinstance(value, dict) and not isinstance(value, Tagged):
            yield from leaves(value, (*path, key))


def at(node: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        node = node.get(key)  # Drake's types do not write what is null.
    return node


TREE = plain(DumpScenario(SHIPPED, named=False))
# Drake adds opacity to colours; file names become absolute.
CHANGED = {"rgba", "demonstration", "demonstration_object", "python", "repository", "weights"}
PATHS = sorted(path for path in leaves(TREE) if path[-1] not in CHANGED)

numbers = st.one_of(
    st.integers(-3, 3),
    st.sampled_from([-1e308, 1e308, 1e-308, float("inf"), float("-inf"), float("nan"), 10**400]),
    st.floats(-10, 10),
)
scalars = st.one_of(
    numbers, st.none(), st.booleans(), st.sampled_from(["", " ", "mug", "1/8", "1/0", "0x1", "~"])
)
values = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(st.sampled_from(["x", "left", "mug", "lower"]), inner, max_size=2),
    ),
    max_leaves=4,
)


def same(loaded: Any, written: Any) -> bool:
    """Returns whether a value was loaded as it was written, or merged over what was there."""
    if isinstance(written, dict):
        # Drake's types do not write what is null.
        return isinstance(loaded, dict) and all(
            same(loaded.get(key), value) for key, value in written.items()
        )
    if isinstance(written, list):
        return len(loaded) == len(written) and all(map(same, loaded, written))
    if isinstance(loaded, float) and isinstance(written, str):
        top, _, bottom = written.partition("/")
        return loaded == float(top) / float(bottom or 1)
    if isinstance(loaded, bool) or isinstance(written, bool):
        return loaded is written
    return loaded == written


@settings(max_examples=1000, deadline=None, derandomize=True)
@given(st.sampled_from(PATHS), values)
def test_a_value_is_used_as_it_is_or_refused(path: tuple[str, ...], value: Any) -> None:
    node = value
    for key in reversed(path):
        node = {key: node}
    try:
        dut = LoadScenario(data=yaml.safe_dump(node), defaults=SHIPPED)
    except ScenarioError:
        return

    assert same(at(plain(DumpScenario(dut, named=False)), path), value)
