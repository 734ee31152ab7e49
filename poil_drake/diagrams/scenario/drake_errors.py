"""Drake's errors about wrong values."""

DRAKE_ERRORS = (RuntimeError, ValueError, TypeError, SystemExit)
"""What Drake raises on wrong values. Its own assertions arrive in Python as SystemExit."""


def drake_reason(error: BaseException) -> str:
    """Returns the text of an error in one line, without a full stop at its end."""
    reason = " ".join(str(error).split())
    # An assertion: "Failure at <file>:<line> in <function>: condition '<C++>' failed."
    if reason.startswith("Failure at ") and ": condition " in reason:
        reason = "Drake requires " + reason.split(": condition ", 1)[1].removesuffix(" failed.")
    return reason.rstrip(".")
