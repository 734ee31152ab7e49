"""Points, joint states and JSON records of a run log."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from poil_drake.errors import InvalidValueError
from poil_drake.recording.mcap.message_parts import MessageParts
from poil_drake.recording.mcap.plain_json import plain_json
from poil_drake.recording.mcap.timestamps import NANOSECONDS_PER_SECOND, set_timestamp

_TIMESTAMP_SCHEMA = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def encode_points(
    points: np.ndarray,
    *,
    stamp: int,
    frame_id: str,
    confidence: np.ndarray | None = None,
    exact: bool = False,
    message: PointCloud | None = None,
) -> MessageParts[PointCloud]:
    """Returns (N, 3) points [m] as a cloud of float32 x, y, z and confidence.

    NaN points are kept, so that a point keeps its index; viewers do not draw them.

    Args:
        points: The points.
        stamp: When they were seen [ns].
        frame_id: The frame that they are in.
        confidence: (N,) their confidence.
        exact: Whether to write float64, which loses nothing.
        message: One of an earlier call for the same frame and columns, which is filled again; None:
            a new one.
    """
    names = ["x", "y", "z"] + ([] if confidence is None else ["confidence"])
    columns = points if confidence is None else np.column_stack([points, confidence])
    size = 8 if exact else 4
    if message is None:
        kind = PackedElementField.FLOAT64 if exact else PackedElementField.FLOAT32
        message = PointCloud(
            frame_id=frame_id,
            point_stride=size * len(names),
            fields=[
                PackedElementField(name=name, offset=size * i, type=kind)
                for i, name in enumerate(names)
            ],
        )
        # An unset pose would be read as a rotation by the zero quaternion.
        message.pose.orientation.w = 1.0
        message.pose.position.SetInParent()
    set_timestamp(message, stamp)
    return MessageParts(message, np.ascontiguousarray(columns, dtype=f"<f{size}").tobytes())


def decode_points(message: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """Returns the (N, 3) points [m] and their (N,) confidence, 1 where none is given.

    Raises:
        InvalidValueError: if the cloud is not one of `encode_points`.
    """
    names = [field.name for field in message.fields]
    kinds = {field.type for field in message.fields}
    size = {frozenset({PackedElementField.FLOAT64}): 8}.get(frozenset(kinds), 4)
    known = kinds <= {PackedElementField.FLOAT32} or size == 8
    offsets = [field.offset for field in message.fields]
    stride = message.point_stride
    if (
        names not in (["x", "y", "z"], ["x", "y", "z", "confidence"])
        or not known
        or offsets != [size * i for i in range(len(names))]
        or stride != size * len(names)
        or len(message.data) % stride
    ):
        raise InvalidValueError(
            f"a point cloud has the fields {names} in {stride} bytes, and {len(message.data)} "
            "bytes in all.",
            remedy="Let poil run write the log.",
        )
    columns = np.frombuffer(message.data, f"<f{size}").reshape(-1, len(names)).astype(float)
    confidence = columns[:, 3].copy() if len(names) == 4 else np.ones(len(columns))
    return columns[:, :3].copy(), confidence


def encode_joint_states(
    names: Sequence[str],
    *,
    stamp: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    effort: np.ndarray | None = None,
    message: JointStates | None = None,
) -> JointStates:
    """Returns the (J,) states of named joints [rad, rad/s, Nm] as a message.

    Args:
        names: The joints.
        stamp: When they were in these states [ns].
        position: Where they were.
        velocity: How fast they moved.
        effort: With what torques.
        message: One of an earlier call for the same joints, which is filled again and returned;
            None: a new one.
    """
    if message is None:
        message = JointStates()
        for name in names:
            message.joints.add(name=name)
    set_timestamp(message, stamp)
    for key, array in (("position", position), ("velocity", velocity), ("effort", effort)):
        if array is None:
            for joint in message.joints:
                joint.ClearField(key)
        else:
            for joint, value in zip(message.joints, array.tolist(), strict=True):
                setattr(joint, key, value)
    return message


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
            f"a joint state lacks the joint '{missing[0]}'.", remedy="Let poil run write the log."
        )
    values = np.full((3, len(names)), np.nan)
    for row, key in enumerate(("position", "velocity", "effort")):
        for column, name in enumerate(names):
            if known[name].HasField(key):
                values[row, column] = getattr(known[name], key)
    return values


def json_record(values: Mapping[str, Any], *, stamp: int) -> dict[str, Any]:
    """Returns values as JSON can hold them, with a `timestamp`; what is not finite becomes null."""
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
    # A number that is null now may come later; an integer may be a float next time.
    return {"type": "string"} if isinstance(value, str) else {"type": "number"}
