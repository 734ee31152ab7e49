"""The plan of an execution: all data that the execution needs, stored in one file.

The file is a NumPy archive of arrays and one JSON header, without pickle.
"""

import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from poil_drake.control.reference.point_trajectory import PointTrajectory
from poil_drake.errors import InvalidValueError, PoilError
from poil_drake.geometry.frozen_array import SharedOnCopy, freeze_fields
from poil_drake.grasping.candidates.grasp_candidate import GraspCandidate
from poil_drake.robots.joint_trajectory import JointTrajectory
from poil_drake.runtime.output_files import whole_file

FORMAT_VERSION = 1
"""Incremented by changes that make older plans unreadable."""

LARGEST_PLAN = 1 << 28
"""Upper bound on the unpacked size of a plan [bytes]."""

_MAKE_ANOTHER = "Create the plan again: poil transfer DEMO SCENARIO -o PLAN"

_HEADER = "header"

_PARTS = {
    "reference": PointTrajectory,
    "approach": JointTrajectory,
    "descent": JointTrajectory,
    "grasp": GraspCandidate,
}
"""The fields of a plan that are dataclasses themselves, with their types."""


class PlanFileError(PoilError):
    """A plan file is missing, unreadable, damaged, incomplete or of another format version."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ExecutionPlan(SharedOnCopy):
    """The result of transfer and grasp selection, which can be stored and executed later.

    Attributes:
        object_label: The object's label.
        part_label: The functional part's label.
        target_points: (N, 3) points that represent the functional part, at planning time
            [m, world].
        object_points: (P, 3) the object's surface at planning time [m, world]. Support points are
            drawn from it.
        part_points: (M, 3) the functional part's surface at planning time [m, world].
        reference: The trajectory that the target points should follow.
        grasp: The grasp.
        approach: Joint motion from the robot's configuration at planning time to the pre-grasp.
        descent: Joint motion from the pre-grasp to the grasp.
        lift_height: Height of the lift before the controller's velocity field takes over [m].
        retreat_distance: Length of the retreat after release [m].
        nominal_posture: (7,) joint positions towards which the rehearsal pulled the arm where the
            gripper's motion left it free [rad].
        metadata: Origin of the plan, such as versions, seed, scenario and costs. JSON must be able
            to represent all values.
    """

    object_label: str
    part_label: str
    target_points: np.ndarray
    object_points: np.ndarray
    part_points: np.ndarray
    reference: PointTrajectory
    grasp: GraspCandidate
    approach: JointTrajectory
    descent: JointTrajectory
    lift_height: float
    retreat_distance: float
    nominal_posture: np.ndarray
    metadata: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = self.reference.positions.shape[1]
        freeze_fields(
            self,
            target_points=(count, 3),
            object_points=("P", 3),
            part_points=("M", 3),
            nominal_posture=(7,),
        )
        for name in ("approach", "descent"):
            joints = getattr(self, name).positions.shape[1]
            if joints != self.nominal_posture.size:
                raise InvalidValueError(
                    f"ExecutionPlan.{name} moves {joints} joints, but nominal_posture has "
                    f"{self.nominal_posture.size}.",
                    remedy="Pass a motion and a posture of the same arm.",
                )
        gap = np.abs(self.approach.positions[-1] - self.descent.positions[0]).max()
        if gap > 1e-6:
            raise InvalidValueError(
                f"ExecutionPlan.descent begins {gap:.3g} rad away from the end of the approach.",
                remedy="End the approach at the configuration at which the descent begins.",
            )
        object.__setattr__(self, "metadata", MappingProxyType(dict(self.metadata)))

    @property
    def grasp_width(self) -> float:
        """Extent of the grasped surface along the closing axis [m]."""
        return self.grasp.width

    @property
    def pregrasp_width(self) -> float:
        """Finger opening while approaching and after releasing [m]."""
        return self.grasp.pregrasp_width

    def save(self, path: Path | str) -> None:
        """Writes the plan to a file. If writing fails, an existing file stays as it was.

        Args:
            path: The file, by convention with the suffix ".npz".

        Raises:
            PlanFileError: JSON cannot represent the metadata.
        """
        data = self.to_bytes()
        with whole_file(Path(path)) as file:
            file.write(data)

    @classmethod
    def load(cls, path: Path | str) -> "ExecutionPlan":
        """Reads a plan from a file that `save` wrote.

        Args:
            path: The file.

        Raises:
            PlanFileError: The file is missing, unreadable, damaged, incomplete or of another format
                version.
        """
        try:
            data = Path(path).read_bytes()
        except OSError as error:
            raise PlanFileError(
                f"The plan '{path}' cannot be read: {error.strerror}.",
                remedy="Check the path and the file's permissions.",
            ) from error
        return cls.from_bytes(data, name=str(path))

    def to_bytes(self) -> bytes:
        """Returns the content of the file that `save` writes.

        Raises:
            PlanFileError: JSON cannot represent the metadata.
        """
        values: dict[str, Any] = {}
        for name in (entry.name for entry in fields(self)):
            value = getattr(self, name)
            if name in _PARTS:
                values |= {f"{name}.{e.name}": getattr(value, e.name) for e in fields(value)}
            else:
                values[name] = dict(value) if isinstance(value, Mapping) else value
        arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        rest = {name: value for name, value in values.items() if name not in arrays}
        try:
            header = json.dumps({"format_version": FORMAT_VERSION, **rest})
        except (TypeError, ValueError) as error:
            raise PlanFileError(
                f"The plan's metadata cannot be written as JSON: {error}.",
                remedy="Use text, numbers, booleans, lists and dictionaries only.",
            ) from error
        stream = io.BytesIO()
        np.savez_compressed(stream, allow_pickle=False, **{_HEADER: np.array(header)}, **arrays)
        return stream.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes, *, name: str) -> "ExecutionPlan":
        """Returns the plan that a file's content describes.

        Args:
            data: The content, as returned by `to_bytes`.
            name: The plan's name in error messages.

        Raises:
            PlanFileError: The data is damaged, incomplete or of another format version.
        """
        values = _unpacked(data, name)
        try:
            parts = {
                owner: kind(**_fields(kind, values, f"{owner}.")) for owner, kind in _PARTS.items()
            }
            return cls(**parts, **_fields(cls, values))
        except KeyError as error:
            raise _unusable(name, f"has no entry {error}") from error
        except (TypeError, ValueError) as error:
            problem = error.problem if isinstance(error, PoilError) else str(error)
            raise _unusable(name, f"holds an invalid value: {problem}") from error


def _unusable(name: str, problem: str) -> PlanFileError:
    problem = " ".join(problem.split()).rstrip(".")
    return PlanFileError(f"The plan '{name}' {problem}.", remedy=_MAKE_ANOTHER)


def _unpacked(data: bytes, name: str) -> dict[str, Any]:
    """Returns arrays and header of a plan's file by name, checked for damage and version."""
    stream = io.BytesIO(data)
    try:
        if not zipfile.is_zipfile(stream):  # NumPy would try to unpickle it.
            raise TypeError("the file is not an archive")
        # Checked before reading: a small file may unpack to more than fits into memory.
        with zipfile.ZipFile(stream) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > LARGEST_PLAN:
                raise TypeError(f"the file unpacks to more than {LARGEST_PLAN >> 20} MB")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            values = dict(archive)
        for entry, value in values.items():
            if not isinstance(value, np.ndarray):  # NumPy returns unknown entries as bytes.
                raise TypeError(f"the entry '{entry}' is not an array")
        if _HEADER not in values:
            raise TypeError(f"the entry '{_HEADER}' is missing")
        header = json.loads(str(values.pop(_HEADER)))
        version = header.pop("format_version", None)
    # Damage makes zipfile, zlib, NumPy, JSON or Python's tokenizer fail, each with its own errors.
    except Exception as error:
        raise _unusable(name, f"cannot be read: {str(error) or type(error).__name__}") from error
    if version != FORMAT_VERSION:
        raise _unusable(name, f"has format version {version}; version {FORMAT_VERSION} is needed")
    return values | header


def _fields(kind: type, values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns the values of a dataclass's fields, after checking their types.

    `values` has each under its field's name, preceded by `prefix`. An empty prefix means the plan
    itself, whose fields in `_PARTS` are skipped.
    """
    found = {}
    for entry in fields(kind):
        if not prefix and entry.name in _PARTS:
            continue
        name = prefix + entry.name
        value = values[name]
        if entry.type is float and not (type(value) in (int, float) and math.isfinite(value)):
            raise TypeError(f"{name} is {value!r}, but a finite number is needed.")
        if entry.type is str and not isinstance(value, str):
            raise TypeError(f"{name} is {value!r}, but a string is needed.")
        if entry.name == "metadata" and not isinstance(value, dict):
            raise TypeError(f"{name} is {value!r}, but a mapping is needed.")
        found[entry.name] = value
    return found
