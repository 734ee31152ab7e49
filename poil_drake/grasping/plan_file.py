"""The file of an execution plan: a NumPy archive of arrays and one JSON text, without pickle."""

import json
import math
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
_TEXTS = ("object_label", "part_label")
_NUMBERS = ("lift_height", "retreat_distance")
_TRAJECTORIES = {
    "reference": PointTrajectory,
    "approach": JointTrajectory,
    "descent": JointTrajectory,
}
_TRAJECTORY_ARRAYS = ("times", "positions", "velocities")
_GRASP_ARRAYS = ("X_WG", "contact_points")
_GRASP_NUMBERS = ("width", "pregrasp_width", "score")


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
        **{name: getattr(plan, name) for name in (*_TEXTS, *_NUMBERS)},
        **{f"grasp.{name}": getattr(plan.grasp, name) for name in _GRASP_NUMBERS},
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
        return _plan(values, header)
    except KeyError as error:
        raise PlanFileError(
            f"The plan '{path}' has no entry {error}.", remedy="Make the plan anew: poil transfer."
        ) from error
    except (TypeError, ValueError) as error:
        problem = error.problem if isinstance(error, PoilError) else " ".join(str(error).split())
        raise PlanFileError(
            f"The plan '{path}' holds values that do not fit together: {problem}",
            remedy="Make the plan anew: poil transfer.",
        ) from error


def _plan(values: dict[str, Any], header: dict[str, Any]) -> ExecutionPlan:
    fields: dict[str, Any] = {name: _text(header, name) for name in _TEXTS}
    fields |= {name: _number(header, name) for name in _NUMBERS}
    fields |= {name: values[name] for name in _ARRAYS}
    fields |= {
        owner: kind(**{name: values[f"{owner}.{name}"] for name in _TRAJECTORY_ARRAYS})
        for owner, kind in _TRAJECTORIES.items()
    }
    grasp: dict[str, Any] = {name: _number(header, f"grasp.{name}") for name in _GRASP_NUMBERS}
    grasp |= {name: values[f"grasp.{name}"] for name in _GRASP_ARRAYS}
    for owner in ("approach", "descent"):
        joints = fields[owner].positions.shape[1]
        if joints != fields["nominal_posture"].size:
            raise InvalidValueError(
                f"{owner}.positions has {joints} joints, nominal_posture "
                f"{fields['nominal_posture'].size}.",
                remedy="Write both for the same arm.",
            )
    return ExecutionPlan(**fields, grasp=GraspCandidate(**grasp), metadata=header["metadata"])


def _text(header: dict[str, Any], name: str) -> str:
    if not isinstance(header[name], str):
        raise TypeError(f"{name} is {header[name]!r}, but a text is needed.")
    return header[name]


def _number(header: dict[str, Any], name: str) -> float:
    value = header[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"{name} is {value!r}, but a finite number is needed.")
    return float(value)


def _read_archive(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise PlanFileError(
            f"There is no plan '{path}'.", remedy="Make one with: poil transfer DEMO SCENARIO -o F"
        )
    try:
        if not zipfile.is_zipfile(path):  # NumPy would take it for a pickle.
            raise TypeError("it is no archive")
        with np.load(path, allow_pickle=False) as archive:
            values = {name: archive[name] for name in archive.files}
        for name, value in values.items():
            # NumPy hands out the bytes of entries that it does not know.
            if not isinstance(value, np.ndarray):
                raise TypeError(f"its entry '{name}' is no array")
        return values
    except Exception as error:
        # What is damaged decides which layer trips: zip, zlib, NumPy's header, Python's tokenizer.
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise PlanFileError(
            f"The plan '{path}' cannot be read: {reason}.",
            remedy="Check that it is a whole .npz file that poil transfer wrote, or make it anew.",
        ) from error


def _read_header(values: dict[str, np.ndarray], path: Path) -> dict:
    remedy = "Check that poil transfer wrote this file, or make it anew."
    if _HEADER not in values:
        raise PlanFileError(f"The plan '{path}' has no entry '{_HEADER}'.", remedy=remedy)
    try:
        header = json.loads(str(values[_HEADER]))
        version = header["format_version"]
        if not isinstance(header["metadata"], dict):
            raise TypeError("its metadata is no mapping")
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise PlanFileError(
            f"The header of '{path}' is damaged: {error}.", remedy=remedy
        ) from error
    if version != FORMAT_VERSION:
        raise PlanFileError(
            f"The plan '{path}' has format version {version}; this program reads {FORMAT_VERSION}.",
            remedy="Make the plan anew with this version: poil transfer DEMO SCENARIO -o F",
        )
    return header
