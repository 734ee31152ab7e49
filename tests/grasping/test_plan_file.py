import json

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from poil_drake.control.joint_trajectory import JointTrajectory
from poil_drake.errors import InvalidValueError
from poil_drake.geometry.rigid_transform import make_transform
from poil_drake.grasping.candidates import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.grasping.plan_file import FORMAT_VERSION, PlanFileError


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

    with pytest.raises(PlanFileError, match=r"plan.npz' cannot be read"):
        ExecutionPlan.load(path)


def test_truncated_file_is_reported(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    path.write_bytes(path.read_bytes()[:-200])

    with pytest.raises(PlanFileError, match="cannot be read"):
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


def test_metadata_beyond_json_is_refused(fields, tmp_path):
    plan = ExecutionPlan(**(fields | {"metadata": {"array": np.zeros(3)}}))

    with pytest.raises(PlanFileError, match="cannot be written as JSON"):
        plan.save(tmp_path / "plan.npz")
    assert not list(tmp_path.iterdir())


def test_descent_must_begin_where_the_approach_ends(fields):
    with pytest.raises(InvalidValueError, match="descent begins"):
        ExecutionPlan(**(fields | {"descent": joint_motion(0.3, 0.5)}))
