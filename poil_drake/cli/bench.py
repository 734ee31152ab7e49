"""The `poil bench` verbs: studies and measurements."""

from pathlib import Path
from typing import Annotated

import typer

from poil_drake.cli.options import ScenarioText, Seed, Tracker, names
from poil_drake.runtime.output_files import require_writable

bench_app = typer.Typer(no_args_is_help=True, help="Run studies and measurements.")

Jobs = Annotated[int, typer.Option("--jobs", min=1, help="Number of trials in parallel.")]
Json = Annotated[Path, typer.Option("--json", help="File for all results (JSON).")]
Pictures = Annotated[
    Path | None,
    typer.Option("--pictures", help="Folder for the pictures. Default: the JSON file's."),
]
Ray = Annotated[
    str | None,
    typer.Option(
        "--ray",
        metavar="ADDRESS",
        help="Run the trials on a Ray cluster: auto, HOST:PORT, ray://HOST:10001, or local.",
    ),
]


@bench_app.command("pipeline")
def bench_pipeline(
    tasks: Annotated[str, typer.Option("--tasks", help="Comma-separated: hang_mug.")] = "hang_mug",
    trials: Annotated[int, typer.Option("--trials", min=1, help="Seeds 0 to trials - 1.")] = 20,
    jobs: Jobs = 1,
    ray: Ray = None,
    tracker: Tracker = None,
    json: Json = Path("out/bench_pipeline.json"),
) -> None:
    """Run the whole job many times, each with random object, pose, texture and noise."""
    from poil_drake.benchmarks.pipeline import run_pipeline_benchmark
    from poil_drake.diagrams.loop.perception import MakeScenarioTracker
    from poil_drake.diagrams.scenario.load import ChooseScenario

    MakeScenarioTracker(ChooseScenario(tracker=tracker).poil)
    require_writable(json)
    run_pipeline_benchmark(
        tasks=names(tasks) or ("hang_mug",),
        trials=trials,
        jobs=jobs,
        tracker=tracker,
        json_path=json,
        ray_address=ray,
    )


@bench_app.command("tracking")
def bench_tracking(
    trackers: Annotated[
        str | None, typer.Option("--trackers", help="Comma-separated. Default: all.")
    ] = None,
    faults: Annotated[
        str | None,
        typer.Option(
            "--faults",
            help="Comma-separated: none, still, slip, occluded, hand, dropped, frozen, delayed, "
            "swapped, depth_holes, depth_bias, depth_scale, extrinsics, dark, untextured, glossy, "
            "transparent. Default: all.",
        ),
    ] = None,
    prior: Annotated[
        bool | None,
        typer.Option(help="Whether trackers get the hand's motion. Default: with and without."),
    ] = None,
    trials: Annotated[int, typer.Option("--trials", min=1, help="Seeds 0 to trials - 1.")] = 20,
    scenario_text: ScenarioText = None,
    jobs: Jobs = 1,
    ray: Ray = None,
    json: Json = Path("out/bench_tracking.json"),
    pictures: Pictures = None,
) -> None:
    """Compare trackers on rendered sequences of a mug that is hung, with and without faults."""
    from poil_drake.benchmarks.tracking.cases import CASES
    from poil_drake.benchmarks.tracking.tracking import run_tracking_benchmark
    from poil_drake.perception.trackers.registry import TRACKERS

    folder = json.parent if pictures is None else pictures
    for path in (json, folder / "tracking.png"):
        require_writable(path)
    run_tracking_benchmark(
        trackers=names(trackers) or tuple(TRACKERS),
        cases=names(faults) or tuple(CASES),
        trials=trials,
        priors=(True, False) if prior is None else (prior,),
        jobs=jobs,
        json_path=json,
        pictures=folder,
        data=scenario_text,
        ray_address=ray,
    )


@bench_app.command("detection")
def bench_detection(
    scenes: Annotated[int, typer.Option("--scenes", min=1, help="Number of scenes.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first scene.")] = 0,
    hidden: Annotated[
        bool, typer.Option("--hidden", help="Hide the handle from all views: refusals are due.")
    ] = False,
    jobs: Jobs = 1,
    json: Json = Path("out/bench_detection.json"),
) -> None:
    """Find a mug and its handle in random scenes, with each detector."""
    from poil_drake.benchmarks.detection.study import run_detection_benchmark

    require_writable(json)
    run_detection_benchmark(
        scenes=scenes, first_seed=seed, hidden=hidden, jobs=jobs, json_path=json
    )


@bench_app.command("loop")
def bench_loop(
    seed: Seed = None, tracker: Tracker = None, json: Json = Path("out/bench_loop.json")
) -> None:
    """Run the whole job once, and show where its time goes, per stage and per system."""
    from poil_drake.benchmarks.latency.loop import run_loop_benchmark
    from poil_drake.diagrams.scenario.load import ChooseScenario

    require_writable(json)
    run_loop_benchmark(scenario=ChooseScenario(seed=seed, tracker=tracker), json_path=json)


@bench_app.command("control")
def bench_control(
    tasks: Annotated[
        str | None,
        typer.Option(
            "--tasks",
            help="Comma-separated: pnp_cube, mug_insertion, reshelving, hanging_bag. Default: all.",
        ),
    ] = None,
    policies: Annotated[
        str | None,
        typer.Option(
            "--policies",
            help="Comma-separated: open_loop, se3_bcsdm, pp_1, pp_50, pp_50_noise, field, "
            "safe_entry. Default: all.",
        ),
    ] = None,
    trials: Annotated[
        int, typer.Option("--trials", min=1, help="Trials in each region of each task.")
    ] = 100,
    hard: Annotated[
        bool, typer.Option(help="Add trials with random orientation, slow tracker and a slip.")
    ] = True,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of starts, slips, noise.")] = 0,
    jobs: Jobs = 1,
    ray: Ray = None,
    json: Json = Path("out/bench_control.json"),
    pictures: Pictures = None,
) -> None:
    """Compare controllers on four tasks with contact, from Near and Far starts (POIL, table II).

    The first run trains the learned baselines, which takes some minutes, and caches them.
    """
    from poil_drake.benchmarks.control.study import ControlStudyConfig, run_control_study

    default = ControlStudyConfig()
    config = ControlStudyConfig(
        tasks=names(tasks) or default.tasks,
        policies=names(policies) or default.policies,
        trials=trials,
        hard=hard,
        seed=seed,
    )
    folder = json.parent if pictures is None else pictures
    for path in (json, folder / "control_paths.png"):
        require_writable(path)
    run_control_study(config, json_path=json, pictures=folder, jobs=jobs, ray_address=ray)


@bench_app.command("stability")
def bench_stability(
    json: Json = Path("out/bench_stability.json"),
    pictures: Pictures = None,
) -> None:
    """Measure the controller's stability and draw the figures of docs/control.md."""
    from poil_drake.benchmarks.stability.stability import run_stability_study

    folder = json.parent if pictures is None else pictures
    for path in (json, folder / "control_escape.png"):
        require_writable(path)
    run_stability_study(pictures=folder, json_path=json)


@bench_app.command("latency")
def bench_latency(
    ticks: Annotated[int, typer.Option("--ticks", min=1, help="Number of repetitions.")] = 5000,
    hardware: Annotated[
        bool,
        typer.Option("--hardware", help="Measure the period of the commands to a simulated robot."),
    ] = False,
    duration: Annotated[
        float,
        typer.Option("--duration", min=10.0, help="With --hardware: length of the run (seconds)."),
    ] = 60.0,
    json: Json = Path("out/bench_latency.json"),
) -> None:
    """Time the vector field, a baseline that works on poses, and the whole control path."""
    require_writable(json)
    if hardware:
        from poil_drake.benchmarks.latency.hardware import run_hardware_latency_benchmark

        run_hardware_latency_benchmark(duration=duration, json_path=json)
    else:
        from poil_drake.benchmarks.latency.latency import run_latency_benchmark

        run_latency_benchmark(ticks=ticks, json_path=json)


@bench_app.command("hardware")
def bench_hardware(
    trials: Annotated[int, typer.Option("--trials", min=1, help="Seeds 0 to trials - 1.")] = 10,
    speed: Annotated[float, typer.Option("--speed", help="Factor on the simulated speed.")] = 0.2,
    time_scale: Annotated[
        float, typer.Option("--time-scale", help="Seconds of the robot's time per second.")
    ] = 1.0,
    json: Json = Path("out/bench_hardware.json"),
) -> None:
    """Run `poil run --hardware` against `poil driver` over LCM, for one seed after another."""
    from poil_drake.benchmarks.hardware.hardware import run_hardware_benchmark
    from poil_drake.diagrams.scenario.load import ChooseScenario

    ChooseScenario(speed=speed, time_scale=time_scale)
    require_writable(json)
    run_hardware_benchmark(trials=trials, speed=speed, time_scale=time_scale, json_path=json)
