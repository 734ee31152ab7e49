"""User mistakes on the command line end in one readable line and a non-zero status."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from command_line import Command

from poil_drake.benchmarks.control import study
from poil_drake.benchmarks.tracking.cases import CASES
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.errors import InvalidValueError

NO_ROBOT = "{lcm_buses: {robot: {lcm_url: 'memq://'}}, poil: {hardware: {ready_timeout: 0.1}}}"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "missing.yaml"], "'missing.yaml' cannot be read"),
        (["run", "--scenario_name", "HangMugs"], "no scenario named 'HangMugs'"),
        (["run", "--scenario_text", "{poil: {etta: 2}}"], "etta"),
        (["run", "--scenario_text", "{poil: {tracker: magic}}"], "'magic'"),
        (["run", "--scenario_text", "{poil: {detector: magic}}"], "'magic'"),
        (["run", "--tracker", ""], "''"),
        (
            ["transfer", "missing.mcap", "--seed", "1", "--scenario_text", "{directives: []}"],
            "'mug'",
        ),
        (["run", "--scenario_text", "{poil: {part: spout}}"], "'spout'"),
        (
            ["run", "--hardware", "--scenario_text", NO_ROBOT],
            "still missing: the robot's status on PANDA_STATUS, the hand's status on",
        ),
        (["run", "--hardware", "--speed", "2"], "poil.hardware.speed is 2.0"),
        (["driver", "--time-scale", "0"], "poil.hardware.time_scale is 0.0"),
        (["driver", "missing.yaml"], "'missing.yaml' cannot be read"),
        (["driver", "--json", "."], "The output '.' is a folder"),
        (
            [
                *("run", "--hardware", "--scenario_text"),
                "{poil: {hardware: {cameras: {top: !RealSense {}}}}}",
            ],
            "names 'top', which is not among the cameras",
        ),
        (
            [
                *("run", "--hardware", "--scenario_text"),
                "{poil: {detector: label_image, hardware: {cameras: {"
                "left: !LcmImages {labels: false}, right: !LcmImages {labels: false}}}}}",
            ],
            "which none of the cameras left, right provides",
        ),
        (["demo", "show", "missing.mcap"], "missing.mcap"),
        (["demo", "import", "missing.mcap", "--camera", "left=/left"], "missing.mcap cannot be"),
        (["demo", "import", ".", "--camera", "left=/left"], ". is not a ROS bag"),
        (["demo", "import", "bag.mcap", "-o", "."], "The output '.' is a folder"),
        (["demo", "import", "demo.mcap", "-o", "demo.mcap"], "overwrite the input 'demo.mcap'"),
        (
            ["demo", "import", "a.mcap", "--camera", "top=/top", "--scenario", "missing.yaml"],
            "'missing.yaml' cannot be read",
        ),
        (["transfer", "missing.mcap"], "missing.mcap"),
        (["execute", "missing.npz"], "missing.npz"),
        (["bench", "pipeline", "--tasks", "juggle"], "'juggle'"),
        (
            ["run", "--json", "/dev/null/x.json", "--scenario_text", "{poil: {part: x}}"],
            "/dev/null",
        ),
        (["run", "."], "'.' cannot be read (Is a directory)"),
        (["run", "a.yaml", "--scenario_file", "b.yaml"], "'a.yaml' and 'b.yaml'"),
        (["run", "--scenario_text", "{poil: {fixture: rak}}"], "poil.fixture is 'rak'"),
        (["run", "--scenario_text", "{cameras: {left: {width: 0}}}"], "cameras.left"),
        (["run", "--scenario_text", "{plant_config: {contact_model: soft}}"], "'soft'"),
        (["run", "--scenario_text", "{poil: {demonstration: no.mcap}}"], "no.mcap"),
        (["run", "--mcap", "."], "The output '.' is a folder"),
        (["run", "--png", "run.gif"], "run.gif"),
        (["run", "--html", "a", "--json", "a"], "both go to 'a'"),
        (["execute", "."], "The plan '.' cannot be read: Is a directory"),
        (["demo", "show", "."], "Is a directory"),
        (["demo", "record", "-o", "."], "The output '.' is a folder"),
        (["demo", "record", "--scenario_text", "{poil: {fixture: rak}}"], "poil.fixture is 'rak'"),
        (["demo", "record", "--hardware", "-o", "."], "The output '.' is a folder"),
        (
            [
                *("demo", "record", "--hardware", "--no-meshcat", "--scenario_text"),
                "{lcm_buses: {images: {lcm_url: 'memq://'}}, "
                "poil: {hardware: {ready_timeout: 0.1}}}",
            ],
            "These cameras delivered nothing within 0.1 s: 'left' (no image), 'right' (no image)",
        ),
        (
            ["demo", "record", "--scenario_text", "{initial_position: {rack: {hinge: [0]}}}"],
            "initial_position cannot be set",
        ),
        (["transfer", "missing.mcap", "-o", "/dev/null/p.npz"], "/dev/null/p.npz"),
        (["bench", "pipeline", "--tracker", "magic"], "'magic'"),
        (["bench", "pipeline", "--json", "."], "The output '.' is a folder"),
        (["bench", "tracking", "--trackers", "eyes"], "'eyes'"),
        (["bench", "tracking", "--faults", "fog"], "'fog'"),
        (["bench", "tracking", "--json", "."], "The output '.' is a folder"),
        (["bench", "control", "--tasks", "juggle"], "'juggle'"),
        (["bench", "control", "--policies", "luck"], "'luck'"),
        (["bench", "control", "--json", "."], "The output '.' is a folder"),
        (["bench", "control", "--pictures", "/dev/null"], "/dev/null"),
        (["bench", "stability", "--json", "."], "The output '.' is a folder"),
        (["bench", "stability", "--pictures", "/dev/null"], "/dev/null"),
        (["bench", "hardware", "--json", "."], "The output '.' is a folder"),
        (["bench", "latency", "--hardware", "--json", "."], "The output '.' is a folder"),
        (["bench", "latency", "--json", "."], "The output '.' is a folder"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_mistakes_end_in_one_line(command: Command, arguments: list[str], said: str) -> None:
    dut = command(*arguments)

    assert dut.status == 1
    assert dut.err.strip() == dut.error
    assert said in dut.error


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "--haste", "9"], "No such option: --haste"),
        (["run", "--realtime-rate", "nan"], "--realtime-rate"),
        (["run", "--realtime-rate", "inf"], "--realtime-rate"),
        (["run", "--realtime-rate", "-1"], "--realtime-rate"),
        (["execute", "plan.npz", "--realtime-rate", "fast"], "--realtime-rate"),
        (["run", "--seed", "-1"], "--seed"),
        (["run", "--dry-run"], "--dry-run works only with --hardware"),
        (["execute", "plan.npz", "--speed", "0.5"], "--speed works only with --hardware"),
        (["demo", "record", "--duration", "5"], "--duration works only with --hardware"),
        (["demo", "record", "--countdown", "0"], "--countdown works only with --hardware"),
        (["demo", "record", "--hardware", "--duration", "0"], "--duration"),
        (["run", "--time-scale", "0.5"], "--time-scale works only with --hardware"),
        (["bench", "latency", "--hardware", "--duration", "1"], "--duration"),
        (["driver", "--duration", "nan"], "--duration"),
        (["driver", "--duration", "-1"], "--duration"),
        (["run", "--seed", "1.5"], "--seed"),
        (["bench", "pipeline", "--trials", "0"], "--trials"),
        (["bench", "control", "--trials", "0"], "--trials"),
        (["bench", "control", "--seed", "-1"], "--seed"),
        (["bench", "latency", "--ticks", "0"], "--ticks"),
        (["demo", "import", "a.mcap", "--camera", "left"], "left is not of the form NAME=VALUE"),
        (["demo", "import", "a.mcap", "--camera", "a=/a", "--camera", "a=/b"], "repeats a name"),
        (["demo", "import", "a.mcap", "--label", "mug=one"], "--label needs whole numbers"),
        (["demo", "import", "a.mcap", "--world", "a", "--scenario", "b"], "--world does not work"),
        (["transfer"], "'demonstration'"),
        (["replay", "missing.mcap"], "missing.mcap cannot be read"),
        (["replay", "."], "cannot be read"),
        (["replay", "missing.mcap", "--png", "a.gif"], "a.gif"),
        (["replay", "missing.mcap", "--json", "."], "The output '.' is a folder"),
        (["replay", "missing.mcap", "--mcap", "missing.mcap"], "would overwrite the input"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_wrong_options_and_unusable_logs_have_their_own_exit_status(
    command: Command, arguments: list[str], said: str
) -> None:
    dut = command(*arguments)

    assert dut.status == 2
    assert said in dut.error


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(28, "No space left on device"), "poil: No space left on device."),
        (OSError(28, "No space left on device", "a.mcap"), "poil: 'a.mcap': No space left"),
        (OSError("odd"), "poil: odd."),
        (InvalidValueError("One\nline.", remedy="Is enough."), "poil: One line. Is enough."),
    ],
)
def test_system_errors_end_in_one_line(
    error: Exception, said: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr("poil_drake.reports.doctor.Examine", fail)

    dut = command("doctor")

    assert dut.status == 1
    assert dut.error.startswith(said)


@pytest.mark.render
def test_the_doctor_finds_nothing_missing_except_for_the_network(command: Command) -> None:
    dut = command("doctor")

    lines = dut.out.splitlines()
    # LCM's own messages may need longer than the doctor waits for them.
    wrong = [line for line in lines if not line.startswith("ok") and "lcm" not in line]
    assert dut.status == 0 or not wrong, lines
    assert any(line.startswith("ok") and "drew 64 x 48 pixels" in line for line in lines)


def test_a_group_of_verbs_alone_shows_its_help(command: Command) -> None:
    dut = command("demo")

    assert dut.status == 2
    assert "record" in dut.out + dut.err
    assert "poil:" not in dut.err


def test_options_of_the_control_study_are_passed_on(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, object] = {}
    monkeypatch.setattr(
        study, "run_control_study", lambda config, **options: seen.update(options, config=config)
    )
    arguments = "--tasks pnp_cube,reshelving --policies field --trials 3 --no-hard --seed 5"
    others = "--jobs 2 --ray local --json a/b.json --pictures c"

    assert command("bench", "control", *arguments.split(), *others.split()).status == 0

    assert seen["config"] == study.ControlStudyConfig(
        tasks=("pnp_cube", "reshelving"), policies=("field",), trials=3, hard=False, seed=5
    )
    del seen["config"]
    assert seen == {
        "json_path": Path("a/b.json"), "pictures": Path("c"), "jobs": 2, "ray_address": "local"
    }  # fmt: skip


def test_help_names_every_task_and_policy(command: Command) -> None:
    said = command("bench", "control", "--help").out

    default = study.ControlStudyConfig()
    assert all(name in said for name in (*default.tasks, *default.policies))


def test_help_names_every_fault(command: Command) -> None:
    said = command("bench", "tracking", "--help").out

    assert all(name in said for name in CASES)


@pytest.mark.parametrize(("same", "status"), [(True, 0), (False, 1)])
def test_a_replay_ends_with_its_verdict(
    command: Command, monkeypatch: pytest.MonkeyPatch, same: bool, status: int
) -> None:
    asked: list[tuple[Path, dict[str, object]]] = []

    def replay(path: Path, **options: object) -> SimpleNamespace:
        asked.append((path, options))
        return SimpleNamespace(same=same, closing_line=lambda: "SAME OR NOT: a line.")

    monkeypatch.setattr("poil_drake.diagrams.replay.replay.Replay", replay)
    options = ["--json", "a.json", "--png", "a.png", "--mcap", "a.mcap"]
    settings = ["--tracker", "recorded", "--scenario_text", "{poil: {eta: 2}}"]

    dut = command("replay", "run.mcap", *options, *settings)

    assert (dut.status, dut.out) == (status, "SAME OR NOT: a line.\n")
    ((path, given),) = asked
    assert path == Path("run.mcap")
    assert given["outputs"] == OutputPaths(
        json=Path("a.json"), png=Path("a.png"), mcap=Path("a.mcap")
    )
    assert (given["tracker"], given["scenario_text"]) == ("recorded", "{poil: {eta: 2}}")
