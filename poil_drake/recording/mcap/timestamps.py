"""Converts between seconds and the integer nanoseconds of MCAP and Foxglove messages."""

import math
from typing import Any

from poil_drake.errors import InvalidValueError

NANOSECONDS_PER_SECOND = 1_000_000_000
_LATEST = 1 << 62  # [ns]; differences of smaller times fit into 64 bits.


def to_nanoseconds(time: float) -> int:
    """Returns `time` [s] in whole nanoseconds.

    Multiples of 1/512 s convert exactly, and `to_seconds` converts them back exactly.

    Raises:
        InvalidValueError: if `time` is negative or not finite, which MCAP cannot hold.
    """
    if not math.isfinite(time) or time < 0.0:
        raise InvalidValueError(
            f"MCAP cannot hold a message at {time} s.",
            remedy="Use a time that is finite and not negative.",
        )
    return round(time * NANOSECONDS_PER_SECOND)


def to_seconds(nanoseconds: int) -> float:
    """Converts whole nanoseconds to seconds, rounded to the nearest float."""
    return nanoseconds / NANOSECONDS_PER_SECOND


def get_timestamp(message: Any, default: int) -> int:
    """Returns the `timestamp` of a Foxglove message [ns], or `default` if it is not set.

    Raises:
        InvalidValueError: if the time is before 1970 or after 2116.
    """
    try:
        time = message.timestamp.ToNanoseconds() if message.HasField("timestamp") else default
        valid = 0 <= time < _LATEST
    except ValueError:  # Protobuf rejects the year 10,000.
        valid = False
    if not valid:
        stamp = message.timestamp
        raise InvalidValueError(
            f"a message has an impossible stamp: {stamp.seconds} s and {stamp.nanos} ns.",
            remedy="Fill in the time of capture since 1970, or 0 for the time of logging.",
        )
    return time
