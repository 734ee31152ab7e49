"""Plan files: a NumPy archive of arrays and one JSON text, without pickle."""

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

from poil_drake.errors import PoilError

FORMAT_VERSION = 1
"""Raised whenever a plan of the old format can no longer be read."""

LARGEST_PLAN = 1 << 28
"""More than any plan takes once it is unpacked [bytes]."""

MAKE_ANOTHER = "Make the plan again: poil transfer DEMO SCENARIO -o PLAN"

_HEADER = "header"


class PlanFileError(PoilError):
    """A plan file is missing, damaged, incomplete or of another version."""


def pack(values: Mapping[str, Any]) -> bytes:
    """Packs named arrays and named values that JSON can hold.

    Raises:
        PlanFileError: A value is neither.
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


def unpack(stream: BinaryIO, *, name: str) -> dict[str, Any]:
    """Returns what `pack` packed.

    Args:
        stream: The packed bytes.
        name: What to call them in an error.

    Raises:
        PlanFileError: They are damaged or of another version.
    """
    try:
        if not zipfile.is_zipfile(stream):  # NumPy would take it for a pickle.
            raise TypeError("it is no archive")
        # Checked before reading: a small file may unpack to more than the memory holds.
        with zipfile.ZipFile(stream) as packed:
            if sum(entry.file_size for entry in packed.infolist()) > LARGEST_PLAN:
                raise TypeError(f"it unpacks to more than {LARGEST_PLAN >> 20} MB")
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            values = dict(archive)
        for entry, value in values.items():
            if not isinstance(value, np.ndarray):  # NumPy returns unknown entries as bytes.
                raise TypeError(f"its entry '{entry}' is no array")
    # Damage trips zip, zlib, NumPy or Python's tokenizer, each with errors of its own.
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
            f"The header of '{name}' is damaged: {error}.", remedy=MAKE_ANOTHER
        ) from error
    if version != FORMAT_VERSION:
        raise PlanFileError(
            f"The plan '{name}' has format version {version}; this program reads {FORMAT_VERSION}.",
            remedy=MAKE_ANOTHER,
        )
    return values | header
