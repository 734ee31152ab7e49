"""The table of faults in the documentation, made by the tests."""

import math
from pathlib import Path
from typing import NamedTuple

DOCUMENT = Path(__file__).parents[2] / "docs" / "hardware_faults.md"

_HEAD = """\
# What happens when things go wrong

Made by `pytest tests/hardware --write-fault-table`: each row is a run against a stand-in robot in
another process, in real time or slowed down; all times are the robot's. Its arm swings at about
0.25 rad/s, more than half of what a fifth of the usual speed allows, when the fault comes. *Known*
is from the fault to its detection, *rest* from there until neither the arm moves faster than
0.01 rad/s nor a command asks it to. Every run ends with a status that is not zero, a complete log
and its figures, unless it is written that it goes on.

| what happens | what is reported | known [ms] | rest [ms] |
|---|---|---:|---:|
"""


class Row(NamedTuple):
    """A fault, what was said, and how long it took to know of it and to rest [ms]."""

    what: str
    reason: str
    known: float
    rest: float

    @property
    def short_reason(self) -> str:
        """The reason without where it came, and what else was noticed."""
        return self.reason.split(" (in phase")[0]


def table(rows: list[Row]) -> str:
    lines = [
        f"| {row.what} | {row.short_reason} | {_number(row.known)} | {_number(row.rest)} |\n"
        for row in rows
    ]
    return _HEAD + "".join(lines)


def documented_rows() -> dict[str, str]:
    """Returns what happens -> what is reported."""
    lines = DOCUMENT.read_text().splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line[:2] == "| "]
    return {what: reason for what, reason, *_ in cells[1:]}


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.0f}"
