"""Describes problems with the messages of a channel."""

from typing import Any

from poil_drake.systems.lcm.mailbox import LcmMailbox

_DAYS = 1e6
"""Clocks that differ by more than this [s] have different time scales."""


def MailboxProblems(mailbox: LcmMailbox[Any], channel: str, tolerance: float) -> list[str]:
    """Returns the problems with the messages of a channel, one clause each.

    Args:
        mailbox: Receives the channel's messages.
        channel: The channel's name.
        tolerance: Largest allowed difference of the sender's clock from the mailbox's [s].
    """
    found = []
    if mailbox.malformed:
        found.append(f"{mailbox.malformed} messages on {channel} could not be read")
    if mailbox.late:
        found.append(f"{mailbox.late} messages on {channel} arrived late or twice")
    if abs(mailbox.offset) > _DAYS:
        found.append(
            f"the messages on {channel} are stamped by a different clock: do their sender and this "
            "program have the same --time-scale?"
        )
    elif abs(mailbox.offset) > tolerance:
        side = "before" if mailbox.offset > 0.0 else "after"
        found.append(
            f"the last message on {channel} was stamped {abs(mailbox.offset):.2f} s {side} it "
            "arrived: are the clocks synchronized?"
        )
    return found
