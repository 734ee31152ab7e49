"""What a check of the machine or the cameras finds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The outcome of one check.

    Attributes:
        name: What was checked.
        ok: Whether the check passed.
        found: The version or device, or the first line of the error.
        remedy: What to do if the check fails, usually an installation command.
    """

    name: str
    ok: bool
    found: str
    remedy: str
