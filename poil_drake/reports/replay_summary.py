"""The summary of a replay: one line for people, one JSON file for programs."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from poil_drake.recording.comparison.run_comparison import TRACKS, PhaseComparison, RunComparison
from poil_drake.recording.comparison.tolerances import (
    ANGULAR_VELOCITY,
    JOINT_VELOCITY,
    LINEAR_VELOCITY,
    TRACKED_POINTS,
)
from poil_drake.recording.mcap.library_versions import library_versions
from poil_drake.recording.mcap.plain_json import plain_json, write_json

_SIGNALS = {
    # Signal             name                  unit, and how many of it are one SI unit
    JOINT_VELOCITY: ("joint velocities", "rad/s", 1.0),
    ANGULAR_VELOCITY: ("angular velocities", "rad/s", 1.0),
    LINEAR_VELOCITY: ("linear velocities", "mm/s", 1e3),
    TRACKED_POINTS: ("tracked points", "mm", 1e3),
}


@dataclass(frozen=True, kw_only=True)
class ReplaySummary:
    """The outcome of a replay.

    Attributes:
        log: Path of the log that was replayed.
        station: The station that wrote the log: simulated, hardware or dry_run.
        tracker: The tracker of the replay; "recorded" if it repeats the tracks of the log.
        changed: Whether the settings of the replay differ from those of the run.
        comparison: How the replay differs from the run.
        replayed: Length of the replayed run [s].
        wall: Wall-clock time of the replay [s].
        notes: Remarks about the log, one clause each.
        outputs: Paths of the files written, by kind.
        versions: Versions of the libraries, by name.
    """

    log: str
    station: str
    tracker: str
    changed: bool
    comparison: RunComparison
    replayed: float
    wall: float
    notes: Sequence[str] = ()
    outputs: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=library_versions)

    @property
    def same(self) -> bool:
        """Whether the replay agrees with the run, within tolerances."""
        return self.comparison.same

    @property
    def reason(self) -> str:
        """One clause that says what replay and run have in common, or where they first differ."""
        first = self.comparison.first
        if first is None:
            if self.same:
                return f"the same {len(self.comparison.phases)} phases"
            if self.comparison.commands:
                return "the commands of the log and of the replay have no times in common"
            return "the log holds no commands to compare"
        when = f"from {first.time:.2f} s on, in phase '{first.phase}'"
        if first.began is not None:
            return f"{when}, the phases differ: {_phase_difference(first.began)}"
        if first.what == TRACKS:
            share = f"{100.0 * first.size:.2g} % of the tracks"
            return f"{when}, {share} have no point that both run and replay saw"
        name, unit, scale = _SIGNALS[first.what]
        return f"{when}, {name} differ by more than {scale * first.tolerance:g} {unit}"

    def closing_line(self) -> str:
        """Returns the one line that ends a replay's output."""
        clauses = [self.reason]
        for signal in (JOINT_VELOCITY, TRACKED_POINTS):
            name, unit, scale = _SIGNALS[signal]
            found = self.comparison.statistics(signal)
            if found.count:
                clauses.append(
                    f"{name} differ by {scale * found.median:.2g} {unit} (median), "
                    f"{scale * found.maximum:.2g} {unit} (max)"
                )
        tracks = self.comparison.tracks
        clauses.append(
            f"{tracks.unmatched} of {len(tracks.pairs)} tracks and {tracks.visibility} of "
            f"{tracks.points} points occur only in the run or only in the replay"
        )
        clauses += self.notes
        clauses.append(f"{self.replayed:.1f} s replayed in {self.wall:.1f} s")
        return f"{'SAME' if self.same else 'DIFFERENT'}: {'; '.join(clauses)}."

    def to_dict(self) -> dict[str, Any]:
        """Returns all fields as JSON values; numbers that are not finite become None."""
        comparison = self.comparison
        signals = {
            signal: {
                **dataclasses.asdict(comparison.statistics(signal)),
                "judged_maximum": comparison.judged_maximum(signal),
                "tolerance": comparison.tolerances.of(signal),
                "phases": {
                    name: dataclasses.asdict(found)
                    for name, found in comparison.statistics_by_phase(signal).items()
                },
            }
            for signal in comparison.differences
        }
        first = comparison.first
        return plain_json(
            {
                "same": self.same,
                "reason": self.reason,
                "log": self.log,
                "station": self.station,
                "tracker": self.tracker,
                "changed": self.changed,
                "phases_agree": comparison.phases_agree,
                "phases": [dataclasses.asdict(phase) for phase in comparison.phases],
                "phase_start_tolerance": comparison.tolerances.phase_start,
                "shift_tolerance": comparison.tolerances.shift,
                "signals": signals,
                "first_difference": None if first is None else dataclasses.asdict(first),
                "unmatched_tracks": comparison.tracks.unmatched,
                "points_seen_by_one_only": comparison.tracks.visibility,
                "timing": {"replayed": self.replayed, "wall": self.wall},
                "notes": list(self.notes),
                "outputs": dict(self.outputs),
                "versions": dict(self.versions),
            }
        )

    def write_json(self, path: str | Path) -> Path:
        """Writes all fields as JSON, creates the folder if needed, and returns the path."""
        write_json(self.to_dict(), Path(path))
        return Path(path)


def _phase_difference(phase: PhaseComparison) -> str:
    if math.isnan(phase.replayed):
        return f"'{phase.name}' began in the run only"
    if math.isnan(phase.recorded):
        return f"'{phase.name}' began in the replay only"
    return f"'{phase.name}' began at {phase.recorded:.2f} s (replay: {phase.replayed:.2f} s)"
