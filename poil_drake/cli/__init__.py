"""The `poil` command: it parses the command line, calls the package and prints."""

import signal
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from poil_drake import __version__
from poil_drake.cli import options, skill
from poil_drake.cli.bench import bench_app
from poil_drake.cli.calibrate import calibrate_app
from poil_drake.cli.demo import demo_app
from poil_drake.cli.label import label
from poil_drake.errors import PoilError
from poil_drake.runtime.held_signals import ENDING

_VERBS = (
    "doctor",
    "run",
    "demo",
    "label",
    "transfer",
    "execute",
    "replay",
    "calibrate",
    "driver",
    "bench",
)


class _OrderOfWork(TyperGroup):
    """Lists the verbs in the order in which a user needs them."""

    def list_commands(self, ctx: Any) -> list[str]:
        return sorted(super().list_commands(ctx), key=_VERBS.index)


app = typer.Typer(
    cls=_OrderOfWork,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    epilog="Tab completion: run `poil --install-completion` and open a new terminal.",
)
app.add_typer(demo_app, name="demo")
app.add_typer(calibrate_app, name="calibrate")
app.add_typer(bench_app, name="bench")
for verb in (label, skill.run, skill.transfer, skill.execute, skill.replay, skill.driver):
    app.command()(verb)


def _print_version(wanted: bool) -> None:
    if wanted:
        try:
            drake = version("drake")
        except PackageNotFoundError:  # Drake was not installed with pip.
            drake = "of unknown version"
        typer.echo(f"poil_drake {__version__}, Drake {drake}")
        raise typer.Exit


@app.callback()
def poil(
    show_version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_print_version,
            is_eager=True,
            help="Print the versions of poil_drake and Drake.",
        ),
    ] = False,
) -> None:
    """One RGB-D demonstration in, a closed-loop robot skill out."""


@app.command()
def doctor(
    scenario: options.ScenarioArgument = None,
    cameras: Annotated[
        bool,
        typer.Option("--cameras", help="Check the depth of the scenario's cameras instead."),
    ] = False,
    hardware: Annotated[
        bool, typer.Option("--hardware", help="With --cameras: the real ones, not rendered ones.")
    ] = False,
    recording: Annotated[
        Path | None,
        typer.Option("--recording", help="With --cameras: those of a recording's first frame."),
    ] = None,
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
) -> None:
    """Check this machine, or a scenario's cameras, and print what to do about it.

    With --cameras, each camera's depth is compared with the table at poil.table_height, and with
    the other cameras' depth.
    """
    if cameras:
        from poil_drake.diagrams.calibration.camera_check import ExamineCameras

        if hardware and recording is not None:
            raise typer.BadParameter("--hardware and --recording exclude each other.")
        chosen = options.choose_scenario(scenario, scenario_name, scenario_text)
        rows = ExamineCameras(chosen, hardware=hardware, recording=recording)
    else:
        from poil_drake.reports.doctor import Examine

        if hardware or any(v is not None for v in (scenario, recording, scenario_text)):
            raise typer.BadParameter("A scenario and its options need --cameras.")
        rows = Examine()
    for row in rows:
        typer.echo(f"{'ok ' if row.ok else 'NO '} {row.name:<12} {row.found}")
        if not row.ok:
            typer.echo(f"    {row.remedy}")
    raise typer.Exit(0 if all(row.ok for row in rows) else 1)


_REASONS: dict[int, str] = {signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal was closed"}


class Stopped(BaseException):
    """Raised when a signal asks the process to end; clean-up runs while it propagates.

    It is not a KeyboardInterrupt, because typer exits on those without a message.

    Attributes:
        number: The signal's number.
    """

    def __init__(self, number: int):
        self.number = number
        super().__init__(_REASONS.get(number, "stopped by the user"))


def main() -> None:
    """Runs the command line. An expected error prints one line and gives a non-zero status."""
    before = {n: signal.signal(n, _stop) for n in ENDING}
    try:
        sys.exit(app(standalone_mode=False) or 0)
    except PoilError as error:
        _fail(str(error), 1)
    except OSError as error:
        where = "" if error.filename is None else f"'{error.filename}': "
        _fail(f"{where}{error.strerror or error}.{' Use another path.' if where else ''}", 1)
    except TyperException as error:
        _fail(error.format_message(), error.exit_code)
    except Stopped as stop:
        _fail(str(stop), 128 + stop.number)
    except typer.Abort:
        _fail("stopped", 130)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)


def _fail(message: str, status: int) -> None:
    if message:  # It is empty after a group's help.
        typer.echo(f"poil: {' '.join(message.split())}", err=True)
    sys.exit(status)
