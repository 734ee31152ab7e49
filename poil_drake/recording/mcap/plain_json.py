"""Converts values to JSON, for files and for the records of run logs."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.recording.mcap.timestamps import NANOSECONDS_PER_SECOND
from poil_drake.runtime.output_files import whole_file

_TIMESTAMP_SCHEMA = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}


def plain_json(value: Any) -> Any:
    """Converts a value to JSON's types: mappings, lists, numbers, strings, booleans and null.

    Arrays and tuples become lists, NumPy scalars become Python scalars, numbers that are not finite
    become None (JSON has no NaN), and any other object becomes its `str`.
    """
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def write_json(value: Any, path: Path, *, indent: int | None = 2) -> None:
    """Writes a value, converted by `plain_json`, to a file through `whole_file`.

    Args:
        value: The value.
        path: The file.
        indent: Spaces per level; None writes everything on one line.

    Raises:
        OSError: if the file cannot be written.
    """
    text = json.dumps(plain_json(value), indent=indent, allow_nan=False)
    with whole_file(path) as file:
        file.write(f"{text}\n".encode())


def json_record(values: Mapping[str, Any], *, stamp: int) -> dict[str, Any]:
    """Returns the values, converted by `plain_json`, with `stamp` [ns] as their `timestamp`."""
    sec, nsec = divmod(stamp, NANOSECONDS_PER_SECOND)
    return {"timestamp": {"sec": sec, "nsec": nsec}} | plain_json(values)


def json_schema(title: str, record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the JSON schema of a `json_record`, from which viewers make menus of its fields."""
    schema = _schema_of({"timestamp": {}} | dict(record))
    schema["properties"]["timestamp"] = _TIMESTAMP_SCHEMA
    return {"title": title} | schema


def _schema_of(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        properties = {key: _schema_of(item) for key, item in value.items()}
        return {"type": "object", "properties": properties}
    if isinstance(value, list):
        return {"type": "array", "items": _schema_of(value[0]) if value else {}}
    if isinstance(value, bool):
        return {"type": "boolean"}
    # A number may be null in one message and an integer or a float in the next.
    return {"type": "string"} if isinstance(value, str) else {"type": "number"}
