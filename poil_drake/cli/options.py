"""What the verbs of the command line have in common: arguments, options, the scenario."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from poil_drake.errors import ScenarioError

if TYPE_CHECKING:
    from poil_drake.diagrams.scenario.scenario import Scenario

ScenarioArgument = Annotated[
    Path | None,
    typer.Argument(help="Scenario file (YAML). Default: the package's, which hangs a mug."),
]
ScenarioFile = Annotated[
    Path | None,
    typer.Option("--scenario_file", help="The same, as Drake's hardware_sim spells it."),
]
ScenarioName = Annotated[
    str | None, typer.Option("--scenario_name", help="Which document of the file to load.")
]
ScenarioText = Annotated[
    str | None,
    typer.Option("--scenario_text", help="YAML laid over the file, e.g. '{poil: {eta: 2}}'."),
]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all randomness.")]
Tracker = Annotated[
    str | None,
    typer.Option("--tracker", help="rigid_flow (default), or the baseline ground_truth."),
]
Detector = Annotated[str | None, typer.Option("--detector", help="label_image.")]
Html = Annotated[Path | None, typer.Option("--html", help="Where the recording goes.")]
Mcap = Annotated[Path | None, typer.Option("--mcap", help="Where the log goes.")]
Png = Annotated[Path | None, typer.Option("--png", help="Where the summary picture goes.")]
Json = Annotated[Path | None, typer.Option("--json", help="Where the figures go.")]
NoMeshcat = Annotated[bool, typer.Option("--no-meshcat", help="Neither live page nor recording.")]


def finite(value: float | None) -> float | None:
    """Refuses what is no finite number."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number.")
    return value


def positive(value: float) -> float:
    """Refuses what is not above 0; infinity is."""
    if not value > 0.0:
        raise typer.BadParameter(f"{value} is not above 0.")
    return value


RealtimeRate = Annotated[
    float | None,
    typer.Option(
        "--realtime-rate",
        min=0.0,
        callback=finite,
        help="Slow down to this rate; 0 runs as fast as it can. Default: the scenario's.",
    ),
]


TimeScale = Annotated[
    float | None,
    typer.Option(
        "--time-scale",
        callback=finite,
        help="Seconds of the robot's time per second; run and simulated driver must agree.",
    ),
]
Speed = Annotated[
    float | None,
    typer.Option(
        "--speed", callback=finite, help="On hardware: share of the usual speed, in (0, 1]."
    ),
]

DryRun = Annotated[
    bool,
    typer.Option(
        "--dry-run",
        help="On hardware: show the motion from where the robot stands; send nothing to it.",
    ),
]


def require_hardware(hardware: bool, realtime_rate: float | None = None, **options: object) -> None:
    """Refuses options that only hardware, or only a simulation, has a use for."""
    if hardware and realtime_rate is not None:
        raise typer.BadParameter("--realtime-rate is for simulations; hardware has --speed.")
    for name, value in options.items():
        if value and not hardware:
            raise typer.BadParameter(f"--{name.replace('_', '-')} is for --hardware only.")


def choose_scenario(
    argument: Path | None,
    file: Path | None,
    name: str | None,
    text: str | None,
    seed: int | None,
    tracker: str | None = None,
    detector: str | None = None,
    speed: float | None = None,
    time_scale: float | None = None,
) -> "Scenario":
    """Returns the scenario of a verb's options; see `ChooseScenario`."""
    from poil_drake.diagrams.scenario.choice import ChooseScenario

    if argument is not None and file is not None:
        raise ScenarioError(
            f"Two scenario files are given, '{argument}' and '{file}'.",
            remedy="Leave out one of them.",
        )
    return ChooseScenario(
        filename=argument or file,
        scenario_name=name,
        data=text,
        seed=seed,
        tracker=tracker,
        detector=detector,
        speed=speed,
        time_scale=time_scale,
    )
