"""Where the outputs of a run go, and the figures of a run that fails early."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import PoilError
from poil_drake.reports.run_summary import RunSummary, RunTiming
from poil_drake.runtime.output_files import OutputError, require_writable
from poil_drake.runtime.stopwatch import Stopwatch

PICTURE_SUFFIXES = (".png", ".pdf", ".svg")
"""Allowed suffixes of the picture. They choose its format."""


@dataclass(frozen=True, kw_only=True)
class OutputPaths:
    """Where the outputs of a run go; an output that is None is not written.

    Attributes:
        html: The Meshcat recording.
        mcap: The log.
        png: The one-page picture.
        json: The figures.
    """

    html: Path | None = None
    mcap: Path | None = None
    png: Path | None = None
    json: Path | None = None

    @classmethod
    def under(cls, directory: Path, *, name: str = "run", **given: Path | None) -> Self:
        """Returns <directory>/<name>.<kind> for each kind of output whose path is not `given`."""
        usual = {kind: directory / f"{name}.{kind}" for kind in ("html", "mcap", "png", "json")}
        return cls(**{kind: given.get(kind) or path for kind, path in usual.items()})

    def check(self, *, inputs: Sequence[str | Path | None] = ()) -> None:
        """Checks that all files can be written, without touching them.

        Args:
            inputs: Files that must not be overwritten; None entries are ignored.

        Raises:
            OutputError: if a file cannot be written or is an input, two are the same, or the
                picture's suffix is not one of `PICTURE_SUFFIXES`.
        """
        paths = self.as_dict()
        for kind, path in paths.items():
            place = path.resolve()
            twins = [k for k, other in paths.items() if k != kind and other.resolve() == place]
            if twins:
                raise OutputError(
                    f"The outputs '{kind}' and '{twins[0]}' both go to '{path}'.",
                    remedy="Name a separate file for each.",
                )
            require_writable(path, inputs=inputs)
        if self.png is not None and self.png.suffix not in PICTURE_SUFFIXES:
            raise OutputError(
                f"The picture '{self.png}' has the unsupported suffix '{self.png.suffix}'.",
                remedy=f"Use one of these suffixes: {', '.join(PICTURE_SUFFIXES)}.",
            )

    def unlink(self) -> None:
        """Removes older output files, so that they cannot be mistaken for new ones.

        Only regular files outside /dev and /proc are removed, so that /dev/stdout can be an output.
        """
        for path in self.as_dict().values():
            devices = {Path("/dev"), Path("/proc")} & set(path.absolute().parents)
            if path.is_file() and not devices:
                path.unlink(missing_ok=True)

    def as_dict(self) -> dict[str, Path]:
        """Returns kind -> path of the outputs that are written."""
        return {kind: path for kind, path in vars(self).items() if path is not None}


@contextmanager
def FreshOutputs(
    outputs: OutputPaths,
    scenario: Scenario,
    stages: Stopwatch,
    *,
    inputs: Sequence[str | Path | None] = (),
) -> Iterator[None]:
    """Removes older outputs before a `with` block, and writes figures if the block raises.

    The figures state the exception, which propagates. Figures that the block has written remain.

    Args:
        outputs: Where the outputs go.
        scenario: The scenario of the job.
        stages: Times of the job's stages, for the figures.
        inputs: Files that must not be overwritten, besides the scenario and its demonstration.

    Raises:
        OutputError: if an output cannot be written; older outputs are then kept.
    """
    outputs.check(inputs=(scenario.source.file, scenario.poil.demonstration, *inputs))
    outputs.unlink()
    try:
        yield
    except BaseException as error:
        if outputs.json is not None and not outputs.json.exists():
            RunSummary(
                success=False,
                reason=failure_reason(error),
                scenario=scenario.source.name,
                scenario_file=scenario.source.file,
                seed=scenario.random_seed,
                tracker=scenario.poil.tracker,
                timing=RunTiming(simulated=0.0, wall=0.0, stages=stages.totals()),
                outputs={"json": str(outputs.json)},
            ).write_json(outputs.json)
        raise


def failure_reason(error: BaseException) -> str:
    """Returns one clause that says why a job ended with an exception."""
    if isinstance(error, PoilError):
        return error.problem.rstrip(".")
    text = " ".join(str(error).split())
    if not isinstance(error, Exception):  # From a Unix signal, e.g. KeyboardInterrupt.
        return text or "stopped by the user"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
