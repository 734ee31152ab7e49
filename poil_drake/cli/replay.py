"""The verb `poil replay`."""

from pathlib import Path
from typing import Annotated

import typer


def replay(
    log: Annotated[Path, typer.Argument(metavar="RUN.mcap", help="The log of a run.")],
    json: Annotated[Path | None, typer.Option("--json", help="Where the figures go.")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Where the picture goes.")] = None,
    mcap: Annotated[Path | None, typer.Option("--mcap", help="Where a log of it goes.")] = None,
    tracker: Annotated[
        str | None,
        typer.Option("--tracker", help="Another tracker, or 'recorded': the run's own tracks."),
    ] = None,
    scenario_text: Annotated[
        str | None,
        typer.Option("--scenario_text", help="YAML laid over the run's scenario."),
    ] = None,
) -> None:
    """Feed a run's log through perception and control again, and compare the commands."""
    from poil_drake.diagrams.replay import Replay
    from poil_drake.diagrams.run_report import OutputPaths

    summary = Replay(
        log,
        tracker=tracker,
        scenario_text=scenario_text,
        outputs=OutputPaths(mcap=mcap, png=png, json=json),
    )
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.same else 1)
