"""Plan files: NumPy archives of arrays and one JSON header, without pickle."""

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from poil_drake.errors import PoilError

FORMAT_VERSION = 1
"""Incremented by changes that make older plans unreadable."""

LARGEST_PLAN = 1 << 28
"""Upper bound on the unpacked size of a plan [bytes]."""

MAKE_ANOTHER = "Create the plan again: poil transfer DEMO SCENARIO -o PLAN"

_HEADER = "header"


class PlanFileError(PoilError):
    """A plan file is missing, unreadable, damaged, incomplete or of another format version."""


def pack(values: Mapping[str, Any]) -> bytes:
    """Returns the content of a plan file.

    Args:
        values: Arrays, and values that JSON can represent, by name.

    Raises:
        PlanFileError: A value is neither an array nor representable in JSON.
    """
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


def unpack(data: bytes, *, name: str) -> dict[str, Any]:
    """Returns the values in the content of a plan file, by name; the inverse of `pack`.

    Args:
        data: The content.
        name: The plan's name in error messages.

    Raises:
        PlanFileError: The data is damaged or of another format version.
    """
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
    # Damage makes zipfile, zlib, NumPy or Python's tokenizer fail, each with its own exceptions.
    except Exception as error:
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise PlanFileError(
            f"The plan '{name}' cannot be read: {reason}.", remedy=MAKE_ANOTHER
        ) from error
    if _HEADER not in values:
        raise PlanFileError(f"The plan '{name}' has no entry '{_HEADER}'.", remedy=MAKE_ANOTHER)
    try:
        header = json.loads(str(values.pop(_HEADER)))
        version = header.pop("format_version")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise PlanFileError(
            f"The header of the plan '{name}' is damaged: {error}.", remedy=MAKE_ANOTHER
        ) from error
    if version != FORMAT_VERSION:
        raise PlanFileError(
            f"The plan '{name}' has format version {version}; version {FORMAT_VERSION} is needed.",
            remedy=MAKE_ANOTHER,
        )
    return values | header
