"""The verb that replays the log of a run."""

from pathlib import Path
from typing import Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.errors import PoilError


def replay(
    log: Annotated[Path, typer.Argument(metavar="RUN.mcap", help="The log of a run.")],
    json: Annotated[Path | None, typer.Option("--json", help="All results.")] = None,
    png: Annotated[Path | None, typer.Option("--png", help="Summary picture.")] = None,
    mcap: Annotated[Path | None, typer.Option("--mcap", help="Log of the replay.")] = None,
    tracker: Annotated[
        str | None,
        typer.Option("--tracker", help="Another tracker, or 'recorded' for the run's own tracks."),
    ] = None,
    scenario_text: Annotated[
        str | None,
        typer.Option("--scenario_text", help="YAML merged over the run's scenario."),
    ] = None,
) -> None:
    """Replay the log of a run, and compare the new commands with the recorded ones.

    Perception and control process the recorded sensor data again. The exit status is 0 if the
    commands are the same, 1 if they differ, and 2 if the log cannot be replayed. Files are written
    only where options name them.
    """
    from poil_drake.diagrams.replay.replay import Replay
    from poil_drake.diagrams.run.output_paths import OutputPaths

    try:
        summary = Replay(
            log,
            tracker=tracker,
            scenario_text=scenario_text,
            outputs=OutputPaths(mcap=mcap, png=png, json=json),
        )
    except (PoilError, OSError) as error:
        text = str(error) if isinstance(error, PoilError) else f"{error.filename}: {error.strerror}"
        failure = TyperException(text)
        failure.exit_code = 2
        raise failure from error
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.same else 1)
