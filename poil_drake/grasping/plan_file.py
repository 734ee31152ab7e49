"""The file of an execution plan: a NumPy archive of arrays and one JSON text, without pickle."""

import io
import json
import math
import os
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.grasping.execution_plan import ExecutionPlan
from poil_drake.robots.joint_trajectory import JointTrajectory

FORMAT_VERSION = 1
"""Raised whenever a plan of the old format can no longer be read."""

LARGEST_PLAN = 1 << 28
"""More than any plan takes once it is unpacked [bytes]."""

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
    data = plan_bytes(plan)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(data)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def plan_bytes(plan: ExecutionPlan) -> bytes:
    """Returns what `write_plan` writes.

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
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def read_plan(path: Path) -> ExecutionPlan:
    """Reads a plan.

    Args:
        path: The file.

    Raises:
        PlanFileError: The file is missing, damaged, incomplete or of another version.
    """
    if not path.is_file():
        raise PlanFileError(
            f"There is no plan '{path}'.", remedy="Make one with: poil transfer DEMO SCENARIO -o F"
        )
    try:
        stream = path.open("rb")
    except OSError as error:
        raise _unreadable(str(path), error) from error
    with stream:
        return _read(stream, str(path))


def plan_of(data: bytes, *, name: str) -> ExecutionPlan:
    """Returns the plan of what `plan_bytes` returned.

    Args:
        data: The bytes.
        name: What to call them in an error.

    Raises:
        PlanFileError: They are damaged, incomplete or of another version.
    """
    return _read(io.BytesIO(data), name)


def _read(stream: BinaryIO, name: str) -> ExecutionPlan:
    values: dict[str, Any] = _read_archive(stream, name)
    header = _read_header(values, name)
    try:
        return _plan(values, header)
    except KeyError as error:
        raise PlanFileError(
            f"The plan '{name}' has no entry {error}.", remedy="Make the plan anew: poil transfer."
        ) from error
    except (TypeError, ValueError) as error:
        problem = error.problem if isinstance(error, PoilError) else " ".join(str(error).split())
        raise PlanFileError(
            f"The plan '{name}' holds values that do not fit together: {problem}",
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


def _read_archive(stream: BinaryIO, name: str) -> dict[str, np.ndarray]:
    try:
        if not zipfile.is_zipfile(stream):  # NumPy would take it for a pickle.
            raise TypeError("it is no archive")
        stream.seek(0)
        # Asked for before reading: what is packed tightly must not ask for all memory.
        with zipfile.ZipFile(stream) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > LARGEST_PLAN:
                raise TypeError(f"it unpacks to more than {LARGEST_PLAN >> 20} MB")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            values = {entry: archive[entry] for entry in archive.files}
        for entry, value in values.items():
            # NumPy hands out the bytes of entries that it does not know.
            if not isinstance(value, np.ndarray):
                raise TypeError(f"its entry '{entry}' is no array")
        return values
    except Exception as error:
        # What is damaged decides which layer trips: zip, zlib, NumPy's header, Python's tokenizer.
        raise _unreadable(name, error) from error


def _unreadable(name: str, error: Exception) -> PlanFileError:
    reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return PlanFileError(
        f"The plan '{name}' cannot be read: {reason}.",
        remedy="Check that it is a whole .npz file that poil transfer wrote, or make it anew.",
    )


def _read_header(values: dict[str, np.ndarray], name: str) -> dict:
    remedy = "Check that poil transfer wrote this file, or make it anew."
    if _HEADER not in values:
        raise PlanFileError(f"The plan '{name}' has no entry '{_HEADER}'.", remedy=remedy)
    try:
        header = json.loads(str(values[_HEADER]))
        version = header["format_version"]
        if not isinstance(header["metadata"], dict):
            raise TypeError("its metadata is no mapping")
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise PlanFileError(
            f"The header of '{name}' is damaged: {error}.", remedy=remedy
        ) from error
    if version != FORMAT_VERSION:
        raise PlanFileError(
            f"The plan '{name}' has format version {version}; this program reads {FORMAT_VERSION}.",
            remedy="Make the plan anew with this version: poil transfer DEMO SCENARIO -o F",
        )
    return header
