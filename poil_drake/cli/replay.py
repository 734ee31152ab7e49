"""The verb `poil replay`."""

from pathlib import Path
from typing import Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.errors import PoilError


class _NotReplayed(TyperException):
    """A log that cannot be replayed, which is neither the same nor different."""

    exit_code = 2


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
    """Feed a run's log through perception and control again, and compare the commands.

    The exit status is 0 if they are the same, 1 if they differ, and 2 if the log cannot be
    replayed.
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
    except PoilError as error:
        raise _NotReplayed(str(error)) from error
    except OSError as error:
        where = "" if error.filename is None else f"'{error.filename}': "
        raise _NotReplayed(f"{where}{error.strerror or error}.") from error
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.same else 1)
