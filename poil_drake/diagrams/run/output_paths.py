"""Where the outputs of a run go."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from poil_drake.runtime.output_files import OutputError, require_writable

PICTURE_SUFFIXES = (".png", ".pdf", ".svg")
"""What the picture's name may end in, which tells its format."""


@dataclass(frozen=True, kw_only=True)
class OutputPaths:
    """Where the outputs of a run go; None leaves one out.

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
        """Returns the usual files in a directory, but for those given."""
        usual = {kind: directory / f"{name}.{kind}" for kind in ("html", "mcap", "png", "json")}
        return cls(**{kind: given.get(kind) or path for kind, path in usual.items()})

    def remove(self, *, inputs: Sequence[str | Path | None] = ()) -> None:
        """Removes the files after checking that all can be written, see `check` and `unlink`."""
        self.check(inputs=inputs)
        self.unlink()

    def check(self, *, inputs: Sequence[str | Path | None] = ()) -> None:
        """Checks that all files can be written; those that are there stay.

        Args:
            inputs: Files that are read and must stay; None stands for none.

        Raises:
            OutputError: when one cannot be written, is an input, or two are the same.
        """
        paths = self._paths
        for kind, path in paths.items():
            place = path.resolve()
            twins = [k for k, other in paths.items() if k != kind and other.resolve() == place]
            if twins:
                raise OutputError(
                    f"The outputs '{kind}' and '{twins[0]}' both go to '{path}'.",
                    remedy="Name a file of its own for each.",
                )
            require_writable(path, inputs=inputs)
        if self.png is not None and self.png.suffix not in PICTURE_SUFFIXES:
            raise OutputError(
                f"The picture '{self.png}' ends in '{self.png.suffix}'.",
                remedy=f"Let it end in one of: {', '.join(PICTURE_SUFFIXES)}.",
            )

    def unlink(self) -> None:
        """Removes the files, where there are any, so that nobody takes them for new ones.

        What is no regular file, such as /dev/stdout, stays, whatever it leads to.
        """
        for path in self._paths.values():
            devices = {Path("/dev"), Path("/proc")} & set(path.absolute().parents)
            if path.is_file() and not devices:
                path.unlink(missing_ok=True)

    @property
    def _paths(self) -> dict[str, Path]:
        return {kind: path for kind, path in vars(self).items() if path is not None}
