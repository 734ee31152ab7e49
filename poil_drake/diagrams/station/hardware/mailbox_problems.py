"""Describes problems with the messages of a channel."""

from typing import Any

from poil_drake.systems.lcm.mailbox import LcmMailbox

_DAYS = 1e6
"""Clocks that differ by more than this [s] count different things."""


def MailboxProblems(mailbox: LcmMailbox[Any], channel: str, tolerance: float) -> list[str]:
    """Returns the problems with the messages of a channel, a sentence each.

    Args:
        mailbox: Receives them.
        channel: The channel's name.
        tolerance: How far the sender's clock may differ from ours [s].
    """
    found = []
    if mailbox.malformed:
        found.append(f"{mailbox.malformed} messages on {channel} could not be read")
    if mailbox.late:
        found.append(f"{mailbox.late} messages on {channel} came late or twice")
    if abs(mailbox.offset) > _DAYS:
        found.append(
            f"the messages on {channel} are stamped by a different clock: is the time scale "
            "(--time-scale) the same there?"
        )
    elif abs(mailbox.offset) > tolerance:
        side = "before" if mailbox.offset > 0.0 else "after"
        found.append(
            f"the last message on {channel} was stamped {abs(mailbox.offset):.2f} s {side} it "
            "came: are the clocks synchronized?"
        )
    return found
