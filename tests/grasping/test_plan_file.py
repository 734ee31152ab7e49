import io
import json
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.grasping import plan_file
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.plan_file import FORMAT_VERSION, PlanFileError
from poil_drake.robots.joint_trajectory import JointTrajectory


def joint_motion(first: float, last: float) -> JointTrajectory:
    times = np.array([0.0, 0.5, 1.0])
    share = np.array([0.0, 0.5, 1.0])[:, None]
    return JointTrajectory(times, first + share * (last - first) * np.ones(7), np.zeros((3, 7)))


@pytest.fixture
def fields(matching, mug) -> dict:
    grasp = GraspCandidate(
        make_transform(np.diag([1.0, -1.0, -1.0]), [0.45, -0.06, 0.09]),
        0.004,
        0.028,
        0.7,
        np.array([[0.45, -0.062, 0.09], [0.45, -0.058, 0.09]]),
    )
    return {
        "object_label": "mug",
        "part_label": "handle",
        "target_points": matching.target_points,
        "object_points": mug.cloud.points,
        "part_points": mug.part_points,
        "reference": matching.reference,
        "grasp": grasp,
        "approach": joint_motion(0.0, 0.4),
        "descent": joint_motion(0.4, 0.5),
        "lift_height": 0.06,
        "retreat_distance": 0.1,
        "nominal_posture": np.linspace(-0.3, 0.3, 7),
        "metadata": {"seed": 3, "scenario": "HangMug", "cost": 0.25},
    }


@pytest.fixture
def plan(fields) -> ExecutionPlan:
    return ExecutionPlan(**fields)


def rewrite(path, **changes) -> None:
    """Replaces entries of a plan's archive; None removes one."""
    with np.load(path) as archive:
        entries = {name: archive[name] for name in archive.files}
    entries |= changes
    with path.open("wb") as file:
        np.savez(file, **{k: v for k, v in entries.items() if v is not None})


def header_with(path, **changes) -> np.ndarray:
    with np.load(path) as archive:
        return np.array(json.dumps(json.loads(str(archive["header"])) | changes))


def test_plan_comes_back_as_it_was(plan, tmp_path):
    plan.save(tmp_path / "plan.npz")

    back = ExecutionPlan.load(tmp_path / "plan.npz")

    for name in ("target_points", "object_points", "part_points", "nominal_posture"):
        assert_array_equal(getattr(back, name), getattr(plan, name))
    for owner in ("reference", "approach", "descent"):
        for name in ("times", "positions", "velocities"):
            assert_array_equal(
                getattr(getattr(back, owner), name), getattr(getattr(plan, owner), name)
            )
    assert_array_equal(back.grasp.X_WG, plan.grasp.X_WG)
    assert_array_equal(back.grasp.contact_points, plan.grasp.contact_points)
    assert (back.grasp_width, back.pregrasp_width, back.grasp.score) == (0.004, 0.028, 0.7)
    assert (back.object_label, back.part_label) == ("mug", "handle")
    assert (back.lift_height, back.retreat_distance) == (0.06, 0.1)
    assert dict(back.metadata) == dict(plan.metadata)


def test_arrays_of_a_plan_are_read_only(plan):
    for array in (plan.target_points, plan.object_points, plan.nominal_posture, plan.grasp.X_WG):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_directories_are_made_and_nothing_else_is_left(plan, tmp_path):
    plan.save(tmp_path / "new" / "plan.npz")

    assert [p.name for p in (tmp_path / "new").iterdir()] == ["plan.npz"]


def test_missing_file_is_named(tmp_path):
    with pytest.raises(PlanFileError, match=r"There is no plan .*nowhere\.npz"):
        ExecutionPlan.load(tmp_path / "nowhere.npz")


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 broken"])
def test_unreadable_file_is_named(tmp_path, content):
    path = tmp_path / "plan.npz"
    path.write_bytes(content)

    with pytest.raises(PlanFileError, match=r"plan.npz' cannot be read: it is no archive"):
        ExecutionPlan.load(path)


def test_truncated_file_is_reported(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    path.write_bytes(path.read_bytes()[:-200])

    with pytest.raises(PlanFileError, match="cannot be read"):
        ExecutionPlan.load(path)


def test_an_entry_without_content_is_named(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (entries | {"nominal_posture.npy": b""}).items():
            archive.writestr(name, content)

    with pytest.raises(PlanFileError, match="'nominal_posture' is no array"):
        ExecutionPlan.load(path)


@pytest.mark.parametrize("name", ["target_points", "reference.times", "grasp.X_WG", "header"])
def test_missing_entry_is_named(plan, tmp_path, name):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, **{name: None})

    with pytest.raises(PlanFileError, match=f"has no entry '{name}'"):
        ExecutionPlan.load(path)


def test_other_version_is_named(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, header=header_with(path, format_version=FORMAT_VERSION + 1))

    with pytest.raises(PlanFileError, match=f"format version {FORMAT_VERSION + 1}"):
        ExecutionPlan.load(path)


def test_damaged_header_is_reported(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, header=np.array("{"))

    with pytest.raises(PlanFileError, match=r"header of .* is damaged"):
        ExecutionPlan.load(path)


def test_values_that_do_not_fit_are_reported(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, target_points=np.zeros((2, 3)))

    with pytest.raises(PlanFileError, match=r"ExecutionPlan.target_points has shape \(2, 3\)"):
        ExecutionPlan.load(path)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"object_label": 3}, "object_label is 3, but a text"),
        ({"lift_height": "high"}, "lift_height is 'high', but a finite number"),
        ({"retreat_distance": float("nan")}, "retreat_distance is nan"),
        ({"grasp.width": None}, "grasp.width is None"),
        ({"metadata": [1]}, r"metadata is \[1\], but a mapping"),
    ],
)
def test_header_values_of_the_wrong_kind_are_named(plan, tmp_path, changes, says):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, header=header_with(path, **changes))

    with pytest.raises(PlanFileError, match=says):
        ExecutionPlan.load(path)


def test_motions_of_another_arm_are_named(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    six = {f"descent.{name}": np.zeros((3, 6)) for name in ("positions", "velocities")}
    rewrite(path, **six)

    with pytest.raises(PlanFileError, match=r"descent.positions has 6 joints"):
        ExecutionPlan.load(path)


def test_text_in_place_of_numbers_is_reported(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    rewrite(path, target_points=np.array(["a"]))

    with pytest.raises(PlanFileError, match="could not convert string"):
        ExecutionPlan.load(path)


@pytest.fixture
def whole_file(plan, tmp_path) -> Path:
    plan.save(tmp_path / "plan.npz")
    return tmp_path / "plan.npz"


def load_bytes(content: bytes) -> None:
    """Reads a plan; whatever is wrong with it, only the typed error may come, in one line."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plan.npz"
        path.write_bytes(content)
        said = ""
        try:
            ExecutionPlan.load(path)
        except PlanFileError as error:
            said = str(error)
        assert "\n" not in said


def damaged(content: bytes, flips: list[tuple[float, int]], kept: float) -> bytes:
    """Flips bits at places given as shares of the length, and cuts the end off."""
    damaged = bytearray(content)
    for place, mask in flips:
        damaged[int(place * (len(content) - 1))] ^= mask
    return bytes(damaged[: int(kept * len(content))])


FLIPS = st.lists(st.tuples(st.floats(0, 1), st.integers(1, 255)), max_size=4)
# The fixtures only hold a file, which no example changes.
SHARED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


@SHARED
@given(flips=FLIPS, kept=st.one_of(st.just(1.0), st.floats(0, 1)))
def test_any_damage_to_the_file_ends_in_the_typed_error(whole_file, flips, kept):
    load_bytes(damaged(whole_file.read_bytes(), flips, kept))


@SHARED
@given(
    entry=st.integers(0, 15), flips=FLIPS, kept=st.one_of(st.just(1.0), st.floats(0, 1)), start=...
)
def test_any_damage_below_the_checksums_ends_in_the_typed_error(
    whole_file, entry: int, flips, kept, start: bool
):
    """The archive is whole, but what it holds is not: as another program might have written it."""
    target = io.BytesIO()
    with zipfile.ZipFile(whole_file) as source, zipfile.ZipFile(target, "w") as copy:
        names = source.namelist()
        for i, name in enumerate(names):
            content = source.read(name)
            if i == entry % len(names):
                # NumPy's header is in the first 128 bytes.
                head = 128 if start else len(content)
                content = damaged(content[:head], flips, kept) + content[head:]
            copy.writestr(name, content)
    load_bytes(target.getvalue())


def test_metadata_beyond_json_is_refused(fields, tmp_path):
    plan = ExecutionPlan(**(fields | {"metadata": {"array": np.zeros(3)}}))

    with pytest.raises(PlanFileError, match="cannot be written as JSON"):
        plan.save(tmp_path / "plan.npz")
    assert not list(tmp_path.iterdir())


def test_descent_must_begin_where_the_approach_ends(fields):
    with pytest.raises(InvalidValueError, match="descent begins"):
        ExecutionPlan(**(fields | {"descent": joint_motion(0.3, 0.5)}))


def test_a_plan_comes_back_from_its_bytes(fields):
    plan = ExecutionPlan(**fields)

    again = ExecutionPlan.from_bytes(plan.to_bytes(), name="the log")

    np.testing.assert_array_equal(again.target_points, plan.target_points)
    np.testing.assert_array_equal(again.approach.positions, plan.approach.positions)
    assert again.metadata == plan.metadata


def test_damaged_bytes_are_named():
    with pytest.raises(PlanFileError, match="The plan 'the log' cannot be read"):
        ExecutionPlan.from_bytes(b"PK but no plan", name="the log")


def test_a_plan_that_unpacks_to_too_much_is_refused(fields, monkeypatch):
    data = ExecutionPlan(**fields).to_bytes()
    monkeypatch.setattr(plan_file, "LARGEST_PLAN", 1000)

    with pytest.raises(PlanFileError, match="unpacks to more than"):
        ExecutionPlan.from_bytes(data, name="the log")
