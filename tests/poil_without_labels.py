"""The command line on stations without label ports, which real cameras do not have either."""

from typing import Any

from pydrake.systems.framework import DiagramBuilder

from poil_drake.cli import main

_export = DiagramBuilder.ExportOutput


def _export_no_labels(self: DiagramBuilder, output: Any, name: str = "") -> int:
    return -1 if name.endswith(".label_image") else _export(self, output, name)


if __name__ == "__main__":
    DiagramBuilder.ExportOutput = _export_no_labels
    main()
