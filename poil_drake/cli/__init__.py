"""The `poil` command: parses, calls, prints. Nothing else."""

import math
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.cli.bench import bench_app
from poil_drake.errors import PoilError, ScenarioError

if TYPE_CHECKING:
    from poil_drake.diagrams.scenario import Scenario

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="One RGB-D demonstration in, a closed-loop robot skill out.",
)
demo_app = typer.Typer(no_args_is_help=True, help="Record and look at demonstrations.")
app.add_typer(demo_app, name="demo")
app.add_typer(bench_app, name="bench")

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


def _finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number.")
    return value


RealtimeRate = Annotated[
    float | None,
    typer.Option(
        "--realtime-rate",
        min=0.0,
        callback=_finite,
        help="Slow down to this rate; 0 runs as fast as it can. Default: the scenario's.",
    ),
]


def _scenario(
    argument: Path | None,
    file: Path | None,
    name: str | None,
    text: str | None,
    seed: int | None,
    tracker: str | None = None,
    detector: str | None = None,
) -> "Scenario":
    from poil_drake.diagrams.scenario_choice import ChooseScenario

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
    )


@app.command()
def run(
    scenario: ScenarioArgument = None,
    scenario_file: ScenarioFile = None,
    scenario_name: ScenarioName = None,
    scenario_text: ScenarioText = None,
    hardware: Annotated[bool, typer.Option("--hardware", help="Drive the real robot.")] = False,
    seed: Seed = None,
    tracker: Tracker = None,
    detector: Detector = None,
    html: Html = None,
    mcap: Mcap = None,
    png: Png = None,
    json: Json = None,
    no_meshcat: NoMeshcat = False,
    realtime_rate: RealtimeRate = None,
) -> None:
    """Do the main job: demonstration, transfer, grasp, closed loop."""
    from poil_drake.diagrams.run_report import OutputPaths
    from poil_drake.diagrams.skill_run import RunSkill

    chosen = _scenario(
        scenario, scenario_file, scenario_name, scenario_text, seed, tracker, detector
    )
    summary = RunSkill(
        chosen,
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        show=not no_meshcat,
        realtime_rate=realtime_rate,
    )
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.success else 1)


@demo_app.command("record")
def demo_record(
    scenario: ScenarioArgument = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Where it goes.")] = Path(
        "out/demo.mcap"
    ),
    scenario_name: ScenarioName = None,
    scenario_text: ScenarioText = None,
    seed: Seed = None,
) -> None:
    """Simulate a demonstration: the object moves by itself, the cameras record."""
    from poil_drake.diagrams.output_files import require_writable
    from poil_drake.diagrams.skill_run import RecordScenarioDemonstration

    chosen = _scenario(scenario, None, scenario_name, scenario_text, seed)
    require_writable(output, inputs=(chosen.source.file,))
    frames = RecordScenarioDemonstration(chosen, output)
    typer.echo(f"recorded {frames} frames to {output}")


@demo_app.command("show")
def demo_show(
    demonstration: Annotated[Path, typer.Argument(help="A demonstration (MCAP).")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Default: its name under out/, ending in .png."),
    ] = None,
) -> None:
    """Draw a demonstration's contact sheet as PNG."""
    from poil_drake.diagrams.output_files import require_writable
    from poil_drake.recording.contact_sheet import contact_sheet
    from poil_drake.recording.demonstration import load_demonstration

    frames = load_demonstration(demonstration)
    picture = output or Path("out") / demonstration.with_suffix(".png").name
    require_writable(picture, inputs=(demonstration,))
    contact_sheet(frames, picture)
    typer.echo(f"drew {picture}")


@app.command()
def transfer(
    demonstration: Annotated[Path, typer.Argument(help="A demonstration (MCAP).")],
    scenario: ScenarioArgument = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Where the plan goes.")] = Path(
        "out/plan.npz"
    ),
    scenario_name: ScenarioName = None,
    scenario_text: ScenarioText = None,
    seed: Seed = None,
    detector: Detector = None,
) -> None:
    """Carry a demonstration over to the scenario's object and choose a grasp."""
    from poil_drake.diagrams.output_files import require_writable
    from poil_drake.diagrams.planning import PlanScenario

    chosen = _scenario(scenario, None, scenario_name, scenario_text, seed, detector=detector)
    require_writable(output, inputs=(demonstration, chosen.source.file))
    plan = PlanScenario(chosen, demonstration)
    plan.save(output)
    typer.echo(f"wrote the plan to {output}")


@app.command()
def execute(
    plan: Annotated[Path, typer.Argument(help="A plan (npz) of `poil transfer`.")],
    scenario: ScenarioArgument = None,
    scenario_name: ScenarioName = None,
    scenario_text: ScenarioText = None,
    hardware: Annotated[bool, typer.Option("--hardware", help="Drive the real robot.")] = False,
    seed: Seed = None,
    tracker: Tracker = None,
    html: Html = None,
    mcap: Mcap = None,
    png: Png = None,
    json: Json = None,
    no_meshcat: NoMeshcat = False,
    realtime_rate: RealtimeRate = None,
) -> None:
    """Execute a plan in closed loop."""
    from poil_drake.diagrams.run_report import OutputPaths
    from poil_drake.diagrams.skill_run import ExecutePlan
    from poil_drake.grasping.execution_plan import ExecutionPlan

    summary = ExecutePlan(
        ExecutionPlan.load(plan),
        _scenario(scenario, None, scenario_name, scenario_text, seed, tracker),
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        show=not no_meshcat,
        realtime_rate=realtime_rate,
        inputs=(plan,),
    )
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.success else 1)


@app.command()
def doctor() -> None:
    """Say what this machine has: rendering, LCM, torch, libraries."""
    from poil_drake.diagrams.doctor import Examine

    rows = Examine()
    for row in rows:
        typer.echo(f"{'ok ' if row.ok else 'NO '} {row.name:<12} {row.found}")
        if not row.ok:
            typer.echo(f"    {row.remedy}")
    raise typer.Exit(0 if all(row.ok for row in rows) else 1)


class Stopped(BaseException):
    """Somebody asked the process to end; what is unfinished is finished on its way up.

    No KeyboardInterrupt, which typer would turn into a status without a word.
    """

    def __init__(self, number: int):
        self.number = number
        super().__init__("terminated" if number == signal.SIGTERM else "stopped by the user")


def main() -> None:
    """Runs the command line; every deliberate error ends in one line and a non-zero status."""
    before = {n: signal.signal(n, _stop) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        sys.exit(app(standalone_mode=False) or 0)
    except PoilError as error:
        _fail(str(error), 1)
    except OSError as error:
        where = "" if error.filename is None else f"'{error.filename}': "
        _fail(f"{where}{error.strerror or error}. Choose a path that can be used.", 1)
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
    if message:  # Where only help was shown, there is nothing to add.
        typer.echo(f"poil: {' '.join(message.split())}", err=True)
    sys.exit(status)
