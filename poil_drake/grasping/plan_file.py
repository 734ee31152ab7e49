"""The file of an execution plan: a NumPy archive of arrays and one JSON text, without pickle."""

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.control.joint_trajectory import JointTrajectory
from poil_drake.control.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.grasping.candidates import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan

FORMAT_VERSION = 1
"""Raised whenever a plan of the old format can no longer be read."""

_HEADER = "header"  # the JSON text
_ARRAYS = ("target_points", "object_points", "part_points", "nominal_posture")
_SCALARS = ("object_label", "part_label", "lift_height", "retreat_distance")
_TRAJECTORIES = {
    "reference": PointTrajectory,
    "approach": JointTrajectory,
    "descent": JointTrajectory,
}
_TRAJECTORY_ARRAYS = ("times", "positions", "velocities")
_GRASP_ARRAYS = ("X_WG", "contact_points")
_GRASP_SCALARS = ("width", "pregrasp_width", "score")


class PlanFileError(PoilError):
    """A file of an execution plan is missing, damaged, incomplete or of another version."""


def write_plan(plan: ExecutionPlan, path: Path) -> None:
    """Writes a plan, whole or not at all.

    Args:
        plan: The plan.
        path: Where to.

    Raises:
        PlanFileError: The metadata holds something that JSON cannot.
    """
    header = {
        "format_version": FORMAT_VERSION,
        "metadata": dict(plan.metadata),
        **{name: getattr(plan, name) for name in _SCALARS},
        **{f"grasp.{name}": getattr(plan.grasp, name) for name in _GRASP_SCALARS},
    }
    try:
        text = json.dumps(header)
    except (TypeError, ValueError) as error:
        raise PlanFileError(
            f"The plan's metadata cannot be written as JSON: {error}.",
            remedy="Use text, numbers, booleans, lists and dictionaries only.",
        ) from error
    arrays: dict[str, Any] = {_HEADER: np.array(text)}
    arrays |= {name: getattr(plan, name) for name in _ARRAYS}
    arrays |= {f"grasp.{name}": getattr(plan.grasp, name) for name in _GRASP_ARRAYS}
    for owner in _TRAJECTORIES:
        for name in _TRAJECTORY_ARRAYS:
            arrays[f"{owner}.{name}"] = getattr(getattr(plan, owner), name)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **arrays)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def read_plan(path: Path) -> ExecutionPlan:
    """Reads a plan.

    Args:
        path: The file.

    Raises:
        PlanFileError: The file is missing, damaged, incomplete or of another version.
    """
    values: dict[str, Any] = _read_archive(path)
    header = _read_header(values, path)
    try:
        fields: dict[str, Any] = {name: header[name] for name in _SCALARS}
        fields |= {name: values[name] for name in _ARRAYS}
        fields |= {
            owner: kind(**{name: values[f"{owner}.{name}"] for name in _TRAJECTORY_ARRAYS})
            for owner, kind in _TRAJECTORIES.items()
        }
        grasp: dict[str, Any] = {name: header[f"grasp.{name}"] for name in _GRASP_SCALARS}
        grasp |= {name: values[f"grasp.{name}"] for name in _GRASP_ARRAYS}
        return ExecutionPlan(**fields, grasp=GraspCandidate(**grasp), metadata=header["metadata"])
    except KeyError as error:
        raise PlanFileError(
            f"The plan '{path}' has no entry {error}.", remedy="Make the plan anew: poil transfer."
        ) from error
    except (InvalidValueError, TypeError) as error:
        raise PlanFileError(
            f"The plan '{path}' holds values that do not fit together: {error}",
            remedy="Make the plan anew: poil transfer.",
        ) from error


def _read_archive(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise PlanFileError(
            f"There is no plan '{path}'.", remedy="Make one with: poil transfer DEMO SCENARIO -o F"
        )
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, AttributeError, zipfile.BadZipFile) as error:
        raise PlanFileError(
            f"The plan '{path}' cannot be read: {error}.",
            remedy="Check that it is a whole .npz file that poil transfer wrote, or make it anew.",
        ) from error


def _read_header(values: dict[str, np.ndarray], path: Path) -> dict:
    remedy = "Check that poil transfer wrote this file, or make it anew."
    if _HEADER not in values:
        raise PlanFileError(f"The plan '{path}' has no entry '{_HEADER}'.", remedy=remedy)
    try:
        header = json.loads(str(values[_HEADER]))
        version = header["format_version"]
    except (ValueError, TypeError, KeyError) as error:
        raise PlanFileError(
            f"The header of '{path}' is damaged: {error}.", remedy=remedy
        ) from error
    if version != FORMAT_VERSION:
        raise PlanFileError(
            f"The plan '{path}' has format version {version}; this program reads {FORMAT_VERSION}.",
            remedy="Make the plan anew with this version: poil transfer DEMO SCENARIO -o F",
        )
    return header
