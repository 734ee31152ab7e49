"""The `poil` command: parses, calls, prints. Nothing else."""

import math
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.cli.bench import bench_app
from poil_drake.cli.options import (
    Detector,
    DryRun,
    Html,
    Json,
    Mcap,
    NoMeshcat,
    Png,
    RealtimeRate,
    ScenarioArgument,
    ScenarioFile,
    ScenarioName,
    ScenarioText,
    Seed,
    Speed,
    TimeScale,
    Tracker,
    choose_scenario,
    positive,
    require_hardware,
)
from poil_drake.cli.replay import replay
from poil_drake.errors import PoilError
from poil_drake.runtime.held_signals import ENDING

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="One RGB-D demonstration in, a closed-loop robot skill out.",
)
demo_app = typer.Typer(no_args_is_help=True, help="Record and look at demonstrations.")
app.add_typer(demo_app, name="demo")
app.add_typer(bench_app, name="bench")
app.command()(replay)


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
    speed: Speed = None,
    time_scale: TimeScale = None,
    dry_run: DryRun = False,
) -> None:
    """Do the main job: demonstration, transfer, grasp, closed loop."""
    require_hardware(hardware, realtime_rate, dry_run=dry_run, speed=speed, time_scale=time_scale)
    from poil_drake.diagrams.run.output_paths import OutputPaths
    from poil_drake.diagrams.run.skill_run import RunSkill

    chosen = choose_scenario(
        scenario,
        scenario_file,
        scenario_name,
        scenario_text,
        seed,
        tracker,
        detector,
        speed,
        time_scale,
    )
    summary = RunSkill(
        chosen,
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        dry_run=dry_run,
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
    from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration
    from poil_drake.runtime.output_files import require_writable

    chosen = choose_scenario(scenario, None, scenario_name, scenario_text, seed)
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
    from poil_drake.recording.demonstration.demonstration import load_demonstration
    from poil_drake.reports.contact_sheet import contact_sheet
    from poil_drake.runtime.output_files import require_writable

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
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Look at the real scene, through the real cameras.")
    ] = False,
) -> None:
    """Carry a demonstration over to the scenario's object and choose a grasp."""
    from poil_drake.diagrams.run.planning import PlanScenario
    from poil_drake.runtime.output_files import require_writable

    chosen = choose_scenario(scenario, None, scenario_name, scenario_text, seed, detector=detector)
    require_writable(output, inputs=(demonstration, chosen.source.file))
    plan = PlanScenario(chosen, demonstration, hardware=hardware)
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
    speed: Speed = None,
    time_scale: TimeScale = None,
    dry_run: DryRun = False,
) -> None:
    """Execute a plan in closed loop."""
    require_hardware(hardware, realtime_rate, dry_run=dry_run, speed=speed, time_scale=time_scale)
    from poil_drake.diagrams.run.output_paths import OutputPaths
    from poil_drake.diagrams.run.skill_run import ExecutePlan
    from poil_drake.grasping.execution_plan import ExecutionPlan

    summary = ExecutePlan(
        ExecutionPlan.load(plan),
        choose_scenario(
            scenario,
            None,
            scenario_name,
            scenario_text,
            seed,
            tracker,
            speed=speed,
            time_scale=time_scale,
        ),
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        dry_run=dry_run,
        show=not no_meshcat,
        realtime_rate=realtime_rate,
        inputs=(plan,),
    )
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.success else 1)


@app.command()
def driver(
    scenario: ScenarioArgument = None,
    scenario_name: ScenarioName = None,
    scenario_text: ScenarioText = None,
    seed: Seed = None,
    time_scale: TimeScale = None,
    duration: Annotated[
        float,
        typer.Option(
            "--duration",
            callback=positive,
            help="End after so long (seconds of the robot's time); by default never.",
        ),
    ] = math.inf,
    json: Annotated[Path | None, typer.Option("--json", help="Where a summary goes.")] = None,
    meshcat: Annotated[
        bool, typer.Option("--meshcat", help="Serve a page that shows the simulated scene.")
    ] = False,
) -> None:
    """Simulate a Franka, its driver and cameras on LCM, for `poil run --hardware` to talk to."""
    from poil_drake.diagrams.run.driver_run import RunDriver
    from poil_drake.runtime.output_files import require_writable

    chosen = choose_scenario(
        scenario, None, scenario_name, scenario_text, seed, time_scale=time_scale
    )
    if json is not None:
        require_writable(json, inputs=(chosen.source.file,))
    RunDriver(chosen, duration=duration, json=json, show=meshcat, say=_say)


def _say(line: str) -> None:
    typer.echo(line)
    sys.stdout.flush()


@app.command()
def doctor() -> None:
    """Say what this machine has: rendering, LCM, torch, libraries."""
    from poil_drake.reports.doctor import Examine

    rows = Examine()
    for row in rows:
        typer.echo(f"{'ok ' if row.ok else 'NO '} {row.name:<12} {row.found}")
        if not row.ok:
            typer.echo(f"    {row.remedy}")
    raise typer.Exit(0 if all(row.ok for row in rows) else 1)


_WORDS: dict[int, str] = {signal.SIGTERM: "terminated", signal.SIGHUP: "the terminal has gone"}


class Stopped(BaseException):
    """Somebody asked the process to end; what is unfinished is finished on its way up.

    No KeyboardInterrupt, which typer would turn into a status without a word.
    """

    def __init__(self, number: int):
        self.number = number
        super().__init__(_WORDS.get(number, "stopped by the user"))


def main() -> None:
    """Runs the command line; every deliberate error ends in one line and a non-zero status."""
    before = {n: signal.signal(n, _stop) for n in ENDING}
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
