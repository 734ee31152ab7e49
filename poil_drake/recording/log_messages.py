"""Points, joint states and JSON records of a run log."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud

from poil_drake.recording.plain_json import plain_json
from poil_drake.recording.timestamps import NANOSECONDS_PER_SECOND, set_timestamp

_TIMESTAMP_SCHEMA = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def encode_points(
    points: np.ndarray, *, stamp: int, frame_id: str, confidence: np.ndarray | None = None
) -> PointCloud:
    """Returns (N, 3) points [m] as a cloud of float32 x, y, z and confidence.

    NaN points are kept, so that a point keeps its index; viewers do not draw them.
    """
    names = ["x", "y", "z"] + ([] if confidence is None else ["confidence"])
    columns = points if confidence is None else np.column_stack([points, confidence])
    message = PointCloud(
        frame_id=frame_id,
        point_stride=4 * len(names),
        fields=[
            PackedElementField(name=name, offset=4 * i, type=PackedElementField.FLOAT32)
            for i, name in enumerate(names)
        ],
        data=np.ascontiguousarray(columns, dtype="<f4").tobytes(),
    )
    # An unset pose would be read as a rotation by the zero quaternion.
    message.pose.orientation.w = 1.0
    message.pose.position.SetInParent()
    set_timestamp(message, stamp)
    return message


def encode_joint_states(
    names: Sequence[str],
    *,
    stamp: int,
    position: np.ndarray | None = None,
    velocity: np.ndarray | None = None,
    effort: np.ndarray | None = None,
) -> JointStates:
    """Returns the (J,) states of named joints [rad, rad/s, Nm] as a message."""
    message = JointStates()
    set_timestamp(message, stamp)
    given = {"position": position, "velocity": velocity, "effort": effort}
    for i, name in enumerate(names):
        values = {key: float(array[i]) for key, array in given.items() if array is not None}
        message.joints.add(name=name, **values)
    return message


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
