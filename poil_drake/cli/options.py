"""Arguments and options that several verbs share."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from poil_drake.errors import ScenarioError

if TYPE_CHECKING:
    from poil_drake.diagrams.scenario.scenario import Scenario


def finite(value: float | None) -> float | None:
    """Returns an option's value (None: not given); rejects infinity and NaN."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number.")
    return value


def positive(value: float | None) -> float | None:
    """Returns an option's value (None: not given); rejects non-positive values and NaN."""
    if value is not None and not value > 0.0:
        raise typer.BadParameter(f"{value} is not a positive number.")
    return value


def names(text: str | None) -> tuple[str, ...]:
    """Returns the names in a comma-separated list; an empty tuple for None."""
    return tuple(name.strip() for name in (text or "").split(",") if name.strip())


ScenarioArgument = Annotated[
    Path | None,
    typer.Argument(help="Scenario file (YAML). Default: the package's, which hangs a mug."),
]
ScenarioFile = Annotated[
    Path | None,
    typer.Option("--scenario_file", help="The same as SCENARIO, as in Drake's hardware_sim."),
]
ScenarioName = Annotated[
    str | None, typer.Option("--scenario_name", help="Name of the scenario in the file.")
]
ScenarioText = Annotated[
    str | None,
    typer.Option("--scenario_text", help="YAML merged over the file, e.g. '{poil: {eta: 2}}'."),
]
Seed = Annotated[
    int | None, typer.Option("--seed", min=0, help="Draw object, pose and noise with this seed.")
]
Tracker = Annotated[
    str | None,
    typer.Option(
        "--tracker",
        help="rigid_flow (default), lucas_kanade, mvtracker, cotracker3, or ground_truth.",
    ),
]
Detector = Annotated[
    str | None,
    typer.Option("--detector", help="demonstration (default), by_hand, by_name, label_image."),
]
Hardware = Annotated[bool, typer.Option("--hardware", help="Drive the real robot.")]
Html = Annotated[
    Path | None, typer.Option("--html", help="Meshcat recording. Default: out/run.html.")
]
Mcap = Annotated[
    Path | None, typer.Option("--mcap", help="Log, with the plan in it. Default: out/run.mcap.")
]
Png = Annotated[Path | None, typer.Option("--png", help="Summary picture. Default: out/run.png.")]
Json = Annotated[Path | None, typer.Option("--json", help="All results. Default: out/run.json.")]
NoMeshcat = Annotated[
    bool, typer.Option("--no-meshcat", help="No live page; a run then has no HTML recording.")
]
RealtimeRate = Annotated[
    float | None,
    typer.Option(
        "--realtime-rate",
        min=0.0,
        callback=finite,
        help="Slow down to this multiple of real time; 0: full speed. Default: the scenario's.",
    ),
]
TimeScale = Annotated[
    float | None,
    typer.Option("--time-scale", help="Robot seconds per second; the same for run and driver."),
]
Speed = Annotated[
    float | None,
    typer.Option("--speed", help="On hardware: factor on the simulated speed, in (0, 1]."),
]
DryRun = Annotated[
    bool,
    typer.Option("--dry-run", help="On hardware: show the motion, but send no commands."),
]


def pairs(entries: Sequence[str] | None, *, option: str) -> dict[str, str]:
    """Returns the NAME=VALUE entries of an option that may be repeated, each name once."""
    found: dict[str, str] = {}
    for entry in entries or ():
        name, equals, value = entry.partition("=")
        if not name or not equals or not value or name in found:
            problem = "repeats a name" if name in found else "is not of the form NAME=VALUE"
            raise typer.BadParameter(f"--{option} {entry} {problem}.")
        found[name] = value
    return found


def label_numbers(entries: Sequence[str] | None) -> dict[str, list[int]]:
    """Returns the NAME=NUMBERS entries of --label, with the numbers separated by commas."""
    try:
        return {
            name: [int(number) for number in numbers.split(",")]
            for name, numbers in pairs(entries, option="label").items()
        }
    except ValueError as error:
        raise typer.BadParameter(f"--label needs whole numbers: {error}.") from error


def require_hardware(hardware: bool, realtime_rate: float | None = None, **options: object) -> None:
    """Rejects --realtime-rate with --hardware, and hardware options without --hardware.

    `options` has the values of the hardware options by name; None or False means "not given".
    """
    if hardware and realtime_rate is not None:
        raise typer.BadParameter("--realtime-rate does not work with --hardware. Use --speed.")
    for name, value in options.items():
        if value and not hardware:
            raise typer.BadParameter(f"--{name.replace('_', '-')} works only with --hardware.")


def choose_scenario(
    argument: Path | None,
    name: str | None,
    text: str | None,
    *,
    file: Path | None = None,
    **changes: Any,
) -> "Scenario":
    """Returns the scenario that the command line chooses.

    `argument` is SCENARIO, and `file` is --scenario_file. `changes` go to `ChooseScenario`.

    Raises:
        ScenarioError: if `argument` and `file` are both given, or the scenario is invalid.
    """
    from poil_drake.diagrams.scenario.load import ChooseScenario

    if argument is not None and file is not None:
        raise ScenarioError(
            f"Two scenario files are given, '{argument}' and '{file}'.", remedy="Remove one."
        )
    return ChooseScenario(filename=argument or file, scenario_name=name, data=text, **changes)
