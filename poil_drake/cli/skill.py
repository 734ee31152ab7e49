"""The verbs run, demo, transfer, execute, replay and driver."""

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer.exceptions import TyperException

from poil_drake.cli import options
from poil_drake.cli.options import choose_scenario, label_numbers, pairs, positive, require_hardware
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


def demo_record(
    scenario: options.ScenarioArgument = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The recording.")] = Path(
        "out/demo.mcap"
    ),
    scenario_name: options.ScenarioName = None,
    scenario_text: options.ScenarioText = None,
    hardware: Annotated[
        bool,
        typer.Option("--hardware", help="Record your own demonstration from the real cameras."),
    ] = False,
    seed: options.Seed = None,
    countdown: Annotated[
        int | None,
        typer.Option("--countdown", min=0, help="From real cameras: seconds to wait. Default: 3."),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            "--duration", callback=positive, help="From real cameras: stop after these seconds."
        ),
    ] = None,
    lossless: Annotated[
        bool,
        typer.Option("--lossless", help="From real cameras: keep all bits; a far larger file."),
    ] = False,
    no_meshcat: Annotated[
        bool, typer.Option("--no-meshcat", help="From real cameras: no live page.")
    ] = False,
    time_scale: options.TimeScale = None,
) -> None:
    """Record a demonstration: simulated without a robot, or your own from real cameras.

    With --hardware, a live page shows what the cameras see. Enter, space or the button on the page
    start and stop the recording. Ctrl-C stops it, too, and keeps what was recorded. A picture of
    the recording is drawn beside it.
    """
    require_hardware(
        hardware,
        countdown=countdown is not None,
        duration=duration,
        lossless=lossless,
        no_meshcat=no_meshcat,
        time_scale=time_scale,
    )
    chosen = choose_scenario(
        scenario, scenario_name, scenario_text, seed=seed, time_scale=time_scale
    )
    require_writable(output, inputs=(chosen.source.file,))
    if hardware:
        from poil_drake.diagrams.demonstration.camera_recorder import RecordFromCameras

        RecordFromCameras(
            chosen,
            output,
            show=not no_meshcat,
            countdown=3 if countdown is None else countdown,
            duration=math.inf if duration is None else duration,
            lossless=lossless,
            picture=output.with_suffix(".png"),
        )
        return
    from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration

    frames = RecordScenarioDemonstration(chosen, output)
    typer.echo(f"recorded {frames} frames to {output}")


def demo_import(
    bag: Annotated[
        Path,
        typer.Argument(
            metavar="BAG", help="A ROS bag: the folder of `ros2 bag record`, .mcap, .db3 or .bag."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The demonstration.")] = Path(
        "out/demo.mcap"
    ),
    camera: Annotated[
        list[str] | None,
        typer.Option(
            "--camera",
            metavar="NAME=PREFIX",
            help="A camera and the prefix of its topics, e.g. left=/left. Repeat it for others.",
        ),
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            "--topic",
            metavar="NAME/KIND=TOPIC",
            help="A topic that is not guessed: image, depth, calibration or label of a camera.",
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(
            "--label",
            metavar="NAME=NUMBERS",
            help="The numbers of an object or part in label images, e.g. mug=3,4 mug/handle=4.",
        ),
    ] = None,
    world: Annotated[
        str | None,
        typer.Option("--world", help="The frame that is the scenario's world. Default: world."),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option("--scenario", help="Take the cameras' poses from a scenario, not from /tf."),
    ] = None,
    start: Annotated[
        float,
        typer.Option("--start", help="Leave out what is earlier [s since the first image]."),
    ] = 0.0,
    end: Annotated[
        float,
        typer.Option("--end", help="Leave out what is later [s since the first image]."),
    ] = math.inf,
) -> None:
    """Import a ROS bag. Without --camera, say what is in it."""
    if scenario is not None and world is not None:
        raise typer.BadParameter("--world does not work with --scenario, which has the poses.")
    from poil_drake.recording.demonstration.layout import WORLD_FRAME
    from poil_drake.recording.ros_bag.bag_import import import_ros_bag

    require_writable(output, inputs=(bag, scenario))
    cameras = pairs(camera or [], option="camera")
    poses = None
    if scenario is not None:
        from poil_drake.diagrams.demonstration.camera_poses import CameraPoses

        poses = CameraPoses(choose_scenario(scenario, None, None), cameras)
    imported = import_ros_bag(
        bag,
        output,
        cameras=cameras,
        topics=pairs(topic or [], option="topic"),
        label_ids=label_numbers(label or []),
        world=world or WORLD_FRAME,
        poses=poses,
        start=start,
        end=end,
    )
    width = max(map(len, imported.topics))
    for own, found in imported.topics.items():
        typer.echo(f"{own:<{width}}  {found}")
    typer.echo(f"imported {imported.frames} frames ({imported.duration:.1f} s) to {output}")


def demo_show(
    demonstration: Annotated[Path, typer.Argument(help="A demonstration (MCAP).")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Default: out/<name of the demonstration>.png."),
    ] = None,
) -> None:
    """Draw a demonstration's contact sheet as PNG."""
    from poil_drake.recording.demonstration.demonstration import load_demonstration
    from poil_drake.reports.contact_sheet import contact_sheet

    frames = load_demonstration(demonstration)
    picture = output or Path("out") / demonstration.with_suffix(".png").name
    require_writable(picture, inputs=(demonstration,))
    contact_sheet(frames, picture)
    typer.echo(f"drew {picture}")


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
