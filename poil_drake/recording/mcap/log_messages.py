"""Decodes the points and joint states of a run log; makes its JSON records."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.plain_json import plain_json
from poil_drake.recording.mcap.timestamps import NANOSECONDS_PER_SECOND

_TIMESTAMP_SCHEMA = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def cloud_fields(names: Sequence[str], size: int) -> list[PackedElementField]:
    """Returns the fields of a point cloud whose columns are floats of `size` 4 or 8 bytes."""
    kind = PackedElementField.FLOAT64 if size == 8 else PackedElementField.FLOAT32
    return [PackedElementField(name=n, offset=size * i, type=kind) for i, n in enumerate(names)]


def decode_points(message: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """Returns the (N, 3) points [m] and their (N,) confidence, 1 where none is given.

    Raises:
        InvalidValueError: if the cloud is not one of `MessageEncoder.points`.
    """
    names, stride = [field.name for field in message.fields], message.point_stride
    size = 8 if PackedElementField.FLOAT64 in {field.type for field in message.fields} else 4
    if (
        names not in (["x", "y", "z"], ["x", "y", "z", "confidence"])
        or list(message.fields) != cloud_fields(names, size)
        or stride != size * len(names)
        or len(message.data) % stride
    ):
        raise InvalidValueError(
            f"a point cloud has the fields {names} in {stride} bytes, and {len(message.data)} "
            "bytes in all.",
            remedy="Write the log with poil run.",
        )
    columns = np.frombuffer(message.data, f"<f{size}").reshape(-1, len(names)).astype(float)
    confidence = columns[:, 3].copy() if len(names) == 4 else np.ones(len(columns))
    return columns[:, :3].copy(), confidence


def decode_joint_states(message: JointStates, names: Sequence[str]) -> np.ndarray:
    """Returns (3, J) positions [rad], velocities [rad/s] and torques [Nm]; NaN where not given.

    Args:
        message: The message.
        names: The joints wanted, in order.

    Raises:
        InvalidValueError: if a joint is missing.
    """
    known = {joint.name: joint for joint in message.joints}
    missing = [name for name in names if name not in known]
    if missing:
        raise InvalidValueError(
            f"a joint state lacks the joint '{missing[0]}'.", remedy="Write the log with poil run."
        )
    values = np.full((3, len(names)), np.nan)
    for row, key in enumerate(("position", "velocity", "effort")):
        for column, name in enumerate(names):
            if known[name].HasField(key):
                values[row, column] = getattr(known[name], key)
    return values


def json_record(values: Mapping[str, Any], *, stamp: int) -> dict[str, Any]:
    """Returns values as a JSON object with a `timestamp`, see `plain_json`."""
    sec, nsec = divmod(stamp, NANOSECONDS_PER_SECOND)
    return {"timestamp": {"sec": sec, "nsec": nsec}} | plain_json(values)


def json_schema(title: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a JSON schema that describes a record of `json_record`, for viewers' menus."""
    properties = {key: _schema_of(value) for key, value in record.items() if key != "timestamp"}
    return {
        "title": title,
        "type": "object",
        "properties": {"timestamp": _TIMESTAMP_SCHEMA} | properties,
    }


def _schema_of(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        return {
            "type": "object",
            "properties": {key: _schema_of(item) for key, item in value.items()},
        }
    if isinstance(value, list):
        return {"type": "array", "items": _schema_of(value[0]) if value else {}}
    if isinstance(value, bool):
        return {"type": "boolean"}
    # A number may be null in one message and an integer or a float in the next.
    return {"type": "string"} if isinstance(value, str) else {"type": "number"}
