"""The verbs run, transfer, execute, replay and driver."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.cli import options
from poil_drake.cli.options import choose_scenario, positive, require_hardware
from poil_drake.errors import PoilError
from poil_drake.runtime.output_files import require_writable

if TYPE_CHECKING:
    from poil_drake.reports.run_summary import RunSummary


def run(
    scenario: options.ScenarioArgument = None,
    scenario_file: options.ScenarioFile = None,
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
    hardware: options.Hardware = False,
    seed: options.Seed = None,
    tracker: options.Tracker = None,
    detector: options.Detector = None,
    html: options.Html = None,
    mcap: options.Mcap = None,
    png: options.Png = None,
    json: options.Json = None,
    no_meshcat: options.NoMeshcat = False,
    realtime_rate: options.RealtimeRate = None,
    speed: options.Speed = None,
    time_scale: options.TimeScale = None,
    dry_run: options.DryRun = False,
) -> None:
    """Do the whole job: demonstration, transfer, grasp, closed loop.

    The outputs are out/run.html, out/run.mcap (with the plan), out/run.png and out/run.json, or
    the paths given by the options; a list of them is printed at the end. The built-in
    demonstration is recorded to demo.mcap beside run.json.
    """
    require_hardware(hardware, realtime_rate, dry_run=dry_run, speed=speed, time_scale=time_scale)
    from poil_drake.diagrams.run.output_paths import OutputPaths
    from poil_drake.diagrams.run.skill_run import RunSkill

    chosen = choose_scenario(
        scenario,
        scenario_name,
        scenario_text,
        file=scenario_file,
        seed=seed,
        tracker=tracker,
        detector=detector,
        speed=speed,
        time_scale=time_scale,
    )
    summary = RunSkill(
        chosen,
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        dry_run=dry_run,
        show=not no_meshcat,
        realtime_rate=realtime_rate,
    )
    _end(summary)


def transfer(
    demonstration: Annotated[Path, typer.Argument(help="A demonstration (MCAP).")],
    scenario: options.ScenarioArgument = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The plan (npz).")] = Path(
        "out/plan.npz"
    ),
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
    seed: options.Seed = None,
    detector: options.Detector = None,
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Use the real cameras to see the scene.")
    ] = False,
) -> None:
    """Make a plan from a demonstration for the scenario's object."""
    from poil_drake.diagrams.run.planning import PlanScenario

    chosen = choose_scenario(scenario, scenario_name, scenario_text, seed=seed, detector=detector)
    page = output.with_suffix(".html")
    for path, other in ((output, page), (page, output)):
        require_writable(path, inputs=(demonstration, chosen.source.file, other))
    PlanScenario(chosen, demonstration, hardware=hardware, output=output)
    typer.echo(f"wrote the plan to {output}")
    typer.echo(f"wrote a page that shows it to {page}")


def execute(
    plan: Annotated[Path, typer.Argument(help="A plan (npz) from `poil transfer`.")],
    scenario: options.ScenarioArgument = None,
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
    hardware: options.Hardware = False,
    seed: options.Seed = None,
    tracker: options.Tracker = None,
    html: options.Html = None,
    mcap: options.Mcap = None,
    png: options.Png = None,
    json: options.Json = None,
    no_meshcat: options.NoMeshcat = False,
    realtime_rate: options.RealtimeRate = None,
    speed: options.Speed = None,
    time_scale: options.TimeScale = None,
    dry_run: options.DryRun = False,
) -> None:
    """Execute a plan in closed loop.

    The outputs are those of `poil run`.
    """
    require_hardware(hardware, realtime_rate, dry_run=dry_run, speed=speed, time_scale=time_scale)
    from poil_drake.diagrams.run.output_paths import OutputPaths
    from poil_drake.diagrams.run.skill_run import ExecutePlan
    from poil_drake.grasping.execution_plan import ExecutionPlan

    chosen = choose_scenario(
        scenario,
        scenario_name,
        scenario_text,
        seed=seed,
        tracker=tracker,
        speed=speed,
        time_scale=time_scale,
    )
    summary = ExecutePlan(
        ExecutionPlan.load(plan),
        chosen,
        outputs=OutputPaths.under(Path("out"), html=html, mcap=mcap, png=png, json=json),
        hardware=hardware,
        dry_run=dry_run,
        show=not no_meshcat,
        realtime_rate=realtime_rate,
        inputs=(plan,),
    )
    _end(summary)


def _end(summary: "RunSummary") -> None:
    """Prints the paths of a run's outputs and its outcome; exits with 0 on success, else 1."""
    titles = {"html": "recording", "mcap": "log", "png": "picture", "json": "figures"}
    for kind, title in titles.items():
        if kind in summary.outputs:
            typer.echo(f"{title:<10} {summary.outputs[kind]}")
    if "mcap" in summary.outputs:
        typer.echo(f"plan       plan.npz in {summary.outputs['mcap']}")
    typer.echo(summary.closing_line())
    raise typer.Exit(0 if summary.success else 1)


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


def driver(
    scenario: options.ScenarioArgument = None,
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
    seed: options.Seed = None,
    time_scale: options.TimeScale = None,
    duration: Annotated[
        float,
        typer.Option(
            "--duration",
            callback=positive,
            help="End after this time (seconds of the robot's time). Default: never.",
        ),
    ] = math.inf,
    json: Annotated[
        Path | None, typer.Option("--json", help="A summary (JSON). Default: none.")
    ] = None,
    meshcat: Annotated[
        bool, typer.Option("--meshcat", help="Serve a page that shows the simulated scene.")
    ] = False,
) -> None:
    """Simulate a Franka's driver and cameras, for `poil run --hardware`."""
    from poil_drake.diagrams.run.driver_run import RunDriver

    chosen = choose_scenario(
        scenario, scenario_name, scenario_text, seed=seed, time_scale=time_scale
    )
    if json is not None:
        require_writable(json, inputs=(chosen.source.file,))
    say = partial(print, flush=True)
    RunDriver(chosen, duration=duration, json=json, show=meshcat, say=say)
