"""Values as JSON can hold them."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from poil_drake.runtime.output_files import whole_file


def plain_json(value: Any) -> Any:
    """Returns a value made of what JSON has: mappings, lists, numbers, text, booleans and null.

    Arrays and tuples become lists, NumPy scalars Python's, what is not finite null (JSON has no
    NaN), and everything else its text.
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
    """Writes a value as `plain_json` makes it; the file appears whole, see `whole_file`.

    Args:
        value: What to write.
        path: Where to.
        indent: Spaces by level; None puts all on one line.

    Raises:
        OSError: if it cannot be written.
    """
    text = json.dumps(plain_json(value), indent=indent, allow_nan=False)
    with whole_file(path) as file:
        file.write(f"{text}\n".encode())
