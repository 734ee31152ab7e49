"""The `poil demo` verbs: record, import and show demonstrations."""

import math
from pathlib import Path
from typing import Annotated

import typer

from poil_drake.cli import options
from poil_drake.cli.options import choose_scenario, label_numbers, pairs, positive, require_hardware
from poil_drake.runtime.output_files import require_writable

demo_app = typer.Typer(no_args_is_help=True, help="Record, import and show demonstrations.")

Output = Annotated[Path, typer.Option("-o", "--output", help="The demonstration.")]


@demo_app.command("record")
def demo_record(
    scenario: options.ScenarioArgument = None,
    output: Output = Path("out/demo.mcap"),
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
    no_meshcat: options.NoMeshcat = False,
) -> None:
    """Record a demonstration: simulated without a robot, or your own from real cameras.

    With --hardware, a live page shows what the cameras see. Enter, space or the button on the page
    start and stop the recording. Ctrl-C stops it, too, and keeps what was recorded. A picture of
    the recording is drawn beside it. The recording is refused if it does not show the object, its
    part and the fixture as the scenario's detector needs it; the file stays.
    """
    require_hardware(
        hardware,
        countdown=countdown is not None,
        duration=duration,
        lossless=lossless,
        no_meshcat=no_meshcat,
    )
    chosen = choose_scenario(scenario, scenario_name, scenario_text, seed=seed)
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
        )
    else:
        from poil_drake.diagrams.run.skill_run import RecordScenarioDemonstration

        frames = RecordScenarioDemonstration(chosen, output)
        typer.echo(f"recorded {frames} frames to {output}")
    from poil_drake.diagrams.demonstration.checks import CheckRecording

    CheckRecording(output, chosen.poil)


@demo_app.command("import")
def demo_import(
    bag: Annotated[
        Path,
        typer.Argument(
            metavar="BAG", help="A ROS bag: the folder of `ros2 bag record`, .mcap, .db3 or .bag."
        ),
    ],
    output: Output = Path("out/demo.mcap"),
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
    cameras = pairs(camera, option="camera")
    poses = None
    if scenario is not None:
        from poil_drake.diagrams.demonstration.camera_poses import CameraPoses

        poses = CameraPoses(choose_scenario(scenario, None, None), cameras)
    imported = import_ros_bag(
        bag,
        output,
        cameras=cameras,
        topics=pairs(topic, option="topic"),
        label_ids=label_numbers(label),
        world=world or WORLD_FRAME,
        poses=poses,
        start=start,
        end=end,
    )
    width = max(map(len, imported.topics))
    for own, found in imported.topics.items():
        typer.echo(f"{own:<{width}}  {found}")
    if "label" in {own.rpartition("/")[2] for own in imported.topics} and not label:
        typer.echo("without --label, no object is known in the label images")
    typer.echo(f"imported {imported.frames} frames ({imported.duration:.1f} s) to {output}")


@demo_app.command("show")
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
