import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from block_scene import make_scene
from hypothesis import given
from hypothesis import strategies as st

from poil_drake.errors import InvalidValueError, LabelError
from poil_drake.perception.detectors.by_hand.hand_labels import (
    BOX,
    EXCLUDE,
    INCLUDE,
    ROLES,
    HandLabels,
    LabelledView,
    Mark,
    labels_path,
)

SCENE = make_scene()
BLANK = HandLabels.of(SCENE.frame)
SOME_MARKS = (
    Mark(view="left", role="object", kind=BOX, at=(60, 20, 105.5, 71)),
    Mark(view="right", role="part", kind=INCLUDE, at=(97, 42.5)),
)

u, v = st.floats(0, 159), st.floats(0, 119)
places = st.sampled_from(["left", "right"]), st.sampled_from(ROLES)
clicks = st.builds(
    lambda view, role, kind, *at: Mark(view=view, role=role, kind=kind, at=at),
    *places,
    st.sampled_from([INCLUDE, EXCLUDE]),
    u,
    v,
)
json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=5,
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("labels") / "scene.labels.json"


@pytest.fixture(scope="module")
def text(path: Path) -> bytes:
    BLANK.with_marks(SOME_MARKS).save(path)
    return path.read_bytes()


@given(marks=st.lists(clicks, max_size=5))
def test_a_saved_file_loads_as_the_same_labels(path: Path, marks: list[Mark]) -> None:
    dut = BLANK.with_marks(marks)

    dut.save(path)

    assert HandLabels.load(path) == dut


@given(data=st.data())
def test_a_file_with_damaged_bytes_loads_or_is_refused_by_name(
    path: Path, text: bytes, data: st.DataObject
) -> None:
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, len(text)))
    path.write_bytes(text[:start] + data.draw(st.binary(max_size=4)) + text[end:])

    loads_or_is_refused_by_name(path)


@given(data=st.data())
def test_a_file_with_another_json_value_loads_or_is_refused_by_name(
    path: Path, text: bytes, data: st.DataObject
) -> None:
    content = json.loads(text)
    parent: Any = content
    key = data.draw(st.sampled_from(list(content)))
    while isinstance(parent[key], dict | list) and data.draw(st.booleans()):
        parent = parent[key]
        key = data.draw(
            st.sampled_from(list(parent if isinstance(parent, dict) else range(len(parent))))
        )
    parent[key] = data.draw(json_values)
    path.write_text(json.dumps(content))

    loads_or_is_refused_by_name(path)


def loads_or_is_refused_by_name(path: Path) -> None:
    problem = ""
    try:
        HandLabels.load(path)
    except LabelError as error:
        problem = error.problem
    assert not problem or str(path) in problem


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("", "damaged"),
        ("[]", "damaged"),
        ("[" * 100_000, "nested"),
        ('{"format": "another 2"}', "format is 'another 2'"),
        ('{"format": "poil_drake hand labels 1", "views": {}, "marks": []}', "no views"),
    ],
)
def test_the_error_says_what_is_wrong_with_a_file(
    tmp_path: Path, content: str, problem: str
) -> None:
    path = tmp_path / "bad.json"
    path.write_text(content)

    with pytest.raises(LabelError, match=f"bad.json.*{problem}"):
        HandLabels.load(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LabelError, match=r"missing\.json.*No such file.*poil label"):
        HandLabels.load(tmp_path / "missing.json")


@pytest.mark.parametrize(
    "change",
    [
        {"view": "rear"},
        {"role": "lid"},
        {"kind": "circle"},
        {"at": (1.0,)},
        {"at": (1.0, float("nan"))},
        {"at": (1.0, 500.0)},
        {"at": "12"},
        {"kind": BOX, "at": (5.0, 5.0, 5.0, 9.0)},
    ],
)
def test_impossible_marks_are_refused(change: dict[str, Any]) -> None:
    mark = {"view": "left", "role": "object", "kind": INCLUDE, "at": (1.0, 2.0), **change}

    with pytest.raises(InvalidValueError):
        BLANK.with_marks([Mark(**mark)])


def test_of_several_boxes_the_last_counts() -> None:
    boxes = [(0, 0, 9, 9), (5, 5, 20, 30)]

    dut = BLANK.with_marks(Mark(view="left", role="part", kind=BOX, at=box) for box in boxes)

    assert dut.box("left", "part") == (5, 5, 20, 30)
    assert dut.box("right", "part") is None


def test_clicks_are_told_apart_by_view_role_and_kind() -> None:
    dut = BLANK.with_marks(
        Mark(view=view, role="object", kind=kind, at=(n, n))
        for n, (view, kind) in enumerate([("left", INCLUDE), ("left", EXCLUDE), ("right", INCLUDE)])
    )

    np.testing.assert_array_equal(dut.clicks("left", "object", include=True), [[0, 0]])
    np.testing.assert_array_equal(dut.clicks("left", "object", include=False), [[1, 1]])
    assert dut.clicks("left", "part", include=True).shape == (0, 2)


def test_noise_and_more_light_leave_a_view_the_same() -> None:
    rgb = SCENE.frame.images[0].rgb
    noise = np.random.default_rng(0).normal(0.0, 8.0, rgb.shape)

    assert LabelledView.of(rgb).shows(np.clip(1.04 * rgb + noise, 0, 255).astype(np.uint8))


def test_another_place_of_an_object_is_another_view() -> None:
    rgb = SCENE.frame.images[0].rgb

    assert not LabelledView.of(rgb).shows(np.roll(rgb, 6, axis=1))


def test_another_image_size_is_another_view() -> None:
    rgb = SCENE.frame.images[0].rgb

    assert not LabelledView.of(rgb).shows(rgb[::2, ::2])


def test_labels_are_beside_their_scene() -> None:
    assert labels_path("data/demo.mcap") == Path("data/demo.labels.json")
