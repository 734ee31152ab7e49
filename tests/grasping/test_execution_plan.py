import io
import json
import zipfile
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_equal

from poil_drake.errors import InvalidValueError
from poil_drake.grasping import execution_plan
from poil_drake.grasping.execution_plan import FORMAT_VERSION, ExecutionPlan, PlanFileError


@pytest.fixture
def data(plan) -> bytes:
    """The content of the plan's file."""
    return plan.to_bytes()


def rewritten(data: bytes, in_header: dict | None = None, **changes) -> bytes:
    """Returns the plan's file with changed entries of file and header; None removes an entry."""
    with np.load(io.BytesIO(data)) as archive:
        entries = dict(archive)
    header = json.loads(str(entries["header"])) | (in_header or {})
    entries["header"] = np.array(json.dumps(header))
    stream = io.BytesIO()
    np.savez(stream, **{k: v for k, v in (entries | changes).items() if v is not None})
    return stream.getvalue()


def values(plan) -> dict:
    """Returns the fields of a plan, or of a part of it, by name; parts become dictionaries."""
    found = {field.name: getattr(plan, field.name) for field in fields(plan)}
    return {name: values(v) if is_dataclass(v) else v for name, v in found.items()}


def test_save_and_load_preserve_the_plan(plan, tmp_path):
    plan.save(tmp_path / "new" / "plan.npz")

    back = ExecutionPlan.load(tmp_path / "new" / "plan.npz")

    assert_equal(values(back), values(plan))
    assert (back.lift_height, back.retreat_distance) == (0.06, 0.1)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["plan.npz"]


def test_arrays_of_a_plan_are_read_only(plan):
    for array in (plan.target_points, plan.object_points, plan.nominal_posture, plan.grasp.X_WG):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_missing_file_is_named(tmp_path):
    with pytest.raises(PlanFileError, match=r"nowhere\.npz' cannot be read: No such file"):
        ExecutionPlan.load(tmp_path / "nowhere.npz")


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 broken"])
def test_unreadable_file_is_named(tmp_path, content):
    path = tmp_path / "plan.npz"
    path.write_bytes(content)

    with pytest.raises(PlanFileError, match=r"plan.npz' cannot be read: the file is not"):
        ExecutionPlan.load(path)


def test_entry_without_content_is_named(data):
    stream = io.BytesIO(data)
    with zipfile.ZipFile(stream, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("nominal_posture.npy", b"")

    with pytest.raises(PlanFileError, match="'nominal_posture' is not an array"):
        ExecutionPlan.from_bytes(stream.getvalue(), name="the log")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"target_points": None}, "The plan 'the log' has no entry 'target_points'"),
        ({"reference.times": None}, "has no entry 'reference.times'"),
        ({"grasp.X_WG": None}, "has no entry 'grasp.X_WG'"),
        ({"header": None}, "'the log' cannot be read: the entry 'header' is missing"),
        ({"header": np.array("{")}, "'the log' cannot be read: Expecting property name"),
        ({"target_points": np.zeros((2, 3))}, r"ExecutionPlan.target_points has shape \(2, 3\)"),
        ({"target_points": np.array(["a"])}, "could not convert string"),
        (
            {"descent.times": np.arange(3.0)}
            | {f"descent.{name}": np.zeros((3, 6)) for name in ("positions", "velocities")},
            "descent moves 6 joints",
        ),
        (
            {"in_header": {"format_version": FORMAT_VERSION + 1}},
            f"format version {FORMAT_VERSION + 1}",
        ),
        ({"in_header": {"object_label": 3}}, "object_label is 3, but a string"),
        ({"in_header": {"lift_height": "high"}}, "lift_height is 'high', but a finite number"),
        ({"in_header": {"retreat_distance": float("nan")}}, "retreat_distance is nan"),
        ({"in_header": {"grasp.width": None}}, "grasp.width is None"),
        ({"in_header": {"metadata": [1]}}, r"metadata is \[1\], but a mapping"),
    ],
)
def test_wrong_entries_are_named(data, changes, says):
    with pytest.raises(PlanFileError, match=says):
        ExecutionPlan.from_bytes(rewritten(data, **changes), name="the log")


def load_damaged(data: bytes) -> None:
    """Checks that reading a plan succeeds, or raises the typed error with one line."""
    said = ""
    try:
        ExecutionPlan.from_bytes(data, name="the log")
    except PlanFileError as error:
        said = str(error)
    assert "\n" not in said


def damaged(content: bytes, flips: list[tuple[float, int]], kept: float) -> bytes:
    """Returns the content with bits flipped at fractions of its length, and its end cut off."""
    damaged = bytearray(content)
    for place, mask in flips:
        damaged[int(place * (len(content) - 1))] ^= mask
    return bytes(damaged[: int(kept * len(content))])


FLIPS = st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), max_size=4)
KEPT = st.one_of(st.just(1.0), st.floats(0, 1))
SHARED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # Never changed.


@SHARED
@given(flips=FLIPS, kept=KEPT)
def test_any_damage_to_the_file_raises_the_typed_error(data, flips, kept):
    load_damaged(damaged(data, flips, kept))


@SHARED
@given(entry=st.integers(0, 15), flips=FLIPS, kept=KEPT, start=...)
def test_any_damage_below_the_checksums_raises_the_typed_error(
    data, entry: int, flips, kept, start: bool
):
    """Damages an entry inside an intact archive, as another program might write it."""
    target = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as source:
        contents = {name: source.read(name) for name in source.namelist()}
    name = list(contents)[entry % len(contents)]
    # NumPy's header is in the first 128 bytes.
    head = 128 if start else len(contents[name])
    contents[name] = damaged(contents[name][:head], flips, kept) + contents[name][head:]
    with zipfile.ZipFile(target, "w") as copy:
        for name, content in contents.items():
            copy.writestr(name, content)
    load_damaged(target.getvalue())


def test_rejects_metadata_beyond_json(plan, tmp_path):
    plan = replace(plan, metadata={"array": np.zeros(3)})

    with pytest.raises(PlanFileError, match="cannot be written as JSON"):
        plan.save(tmp_path / "plan.npz")
    assert not list(tmp_path.iterdir())


def test_descent_must_begin_where_the_approach_ends(plan):
    with pytest.raises(InvalidValueError, match="descent begins"):
        replace(plan, descent=plan.approach)


def test_rejects_a_plan_that_unpacks_to_too_much(data, monkeypatch):
    monkeypatch.setattr(execution_plan, "LARGEST_PLAN", 1000)

    with pytest.raises(PlanFileError, match="unpacks to more than"):
        ExecutionPlan.from_bytes(data, name="the log")
