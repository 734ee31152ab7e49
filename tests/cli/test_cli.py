"""User mistakes on the command line end in one readable line and a non-zero status."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from poil_drake import cli
from poil_drake.benchmarks.control import study
from poil_drake.diagrams.run.output_paths import OutputPaths
from poil_drake.errors import InvalidValueError

NO_ROBOT = "{lcm_buses: {robot: {lcm_url: 'memq://'}}, poil: {hardware: {ready_timeout: 0.1}}}"


def run(monkeypatch: pytest.MonkeyPatch, arguments: Sequence[str]) -> int:
    monkeypatch.setattr("sys.argv", ["poil", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    return lines[0]


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
        (["run", "--scenario_text", "{poil: {eta: -1}}"], "eta"),
        (["run", "--scenario_text", "{poil: ["], "not valid YAML"),
        (
            ["run", "--hardware", "--scenario_text", NO_ROBOT],
            "still missing: the robot's status on PANDA_STATUS, the hand's status on",
        ),
        (["run", "--hardware", "--speed", "2"], "poil.hardware.speed is 2.0"),
        (["driver", "--time-scale", "0"], "poil.hardware.time_scale is 0.0"),
        (["driver", "missing.yaml"], "'missing.yaml' cannot be read"),
        (["driver", "--json", "."], "The output '.' is a folder"),
        (
            ["run", "--scenario_text", "{poil: {hardware: {cameras: {left: !Leica {}}}}}"],
            "Leica",
        ),
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
                "{poil: {hardware: {cameras: {left: !LcmImages {labels: false}}}}}",
            ],
            "which camera 'left' does not give",
        ),
        (
            ["driver", "--scenario_text", "{lcm_buses: {robot: {lcm_url: 'udpm://no'}}}"],
            "udpm://no",
        ),
        (["demo", "show", "missing.mcap"], "missing.mcap"),
        (["transfer", "missing.mcap"], "missing.mcap"),
        (["execute", "missing.npz"], "missing.npz"),
        (["bench", "pipeline", "--tasks", "juggle"], "'juggle'"),
        (
            ["run", "--json", "/dev/null/x.json", "--scenario_text", "{poil: {part: x}}"],
            "/dev/null",
        ),
        (["run", "."], "'.' cannot be read (Is a directory)"),
        (["run", "a.yaml", "--scenario_file", "b.yaml"], "'a.yaml' and 'b.yaml'"),
        (["run", "--scenario_text", "mug"], "a mapping (Scenario) is needed"),
        (["run", "--scenario_text", "{random_seed: -1}"], "random_seed is -1"),
        (["run", "--scenario_text", "{poil: {fixture: rak}}"], "poil.fixture is 'rak'"),
        (["run", "--scenario_text", "{cameras: {left: {width: 0}}}"], "cameras.left"),
        (["run", "--scenario_text", "{plant_config: {contact_model: soft}}"], "'soft'"),
        (["run", "--scenario_text", "{poil: {demonstration: no.mcap}}"], "no.mcap"),
        (["run", "--mcap", "."], "The output '.' is a folder"),
        (["run", "--png", "run.gif"], "run.gif"),
        (["run", "--html", "a", "--json", "a"], "both go to 'a'"),
        (["execute", "."], "There is no plan '.'"),
        (["demo", "show", "."], "Is a directory"),
        (["demo", "record", "-o", "."], "The output '.' is a folder"),
        (["demo", "record", "--scenario_text", "{poil: {fixture: rak}}"], "poil.fixture is 'rak'"),
        (
            ["demo", "record", "--scenario_text", "{initial_position: {rack: {hinge: [0]}}}"],
            "initial_position cannot be set",
        ),
        (["transfer", "missing.mcap", "-o", "/dev/null/p.npz"], "/dev/null/p.npz"),
        (["bench", "pipeline", "--tracker", "magic"], "'magic'"),
        (["bench", "pipeline", "--json", "."], "The output '.' is a folder"),
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
def test_mistakes_end_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)

    status = run(monkeypatch, arguments)

    assert status == 1
    line = one_line(capsys)
    assert line.startswith("poil: ")
    assert said in line


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["missing.mcap"], "missing.mcap cannot be read"),
        (["."], "cannot be read"),
        (["missing.mcap", "--png", "a.gif"], "a.gif"),
        (["missing.mcap", "--json", "."], "The output '.' is a folder"),
        (["missing.mcap", "--mcap", "missing.mcap"], "would overwrite the input"),
    ],
)
def test_a_log_that_cannot_be_replayed_is_told_from_one_that_differs(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)

    assert run(monkeypatch, ["replay", *arguments]) == 2

    line = one_line(capsys)
    assert line.startswith("poil: ")
    assert said in line


def test_unknown_options_name_the_usage(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["run", "--haste", "9"]) == 2
    assert "No such option" in one_line(capsys)


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["run", "--realtime-rate", "nan"], "--realtime-rate"),
        (["run", "--realtime-rate", "inf"], "--realtime-rate"),
        (["run", "--realtime-rate", "-1"], "--realtime-rate"),
        (["execute", "plan.npz", "--realtime-rate", "fast"], "--realtime-rate"),
        (["run", "--seed", "-1"], "--seed"),
        (["run", "--dry-run"], "--dry-run is for --hardware only"),
        (["execute", "plan.npz", "--speed", "0.5"], "--speed is for --hardware only"),
        (["run", "--time-scale", "0.5"], "--time-scale is for --hardware only"),
        (["bench", "latency", "--hardware", "--duration", "1"], "--duration"),
        (["driver", "--duration", "nan"], "--duration"),
        (["driver", "--duration", "-1"], "--duration"),
        (["run", "--seed", "1.5"], "--seed"),
        (["bench", "pipeline", "--trials", "0"], "--trials"),
        (["bench", "control", "--trials", "0"], "--trials"),
        (["bench", "control", "--seed", "-1"], "--seed"),
        (["bench", "latency", "--ticks", "0"], "--ticks"),
        (["transfer"], "'demonstration'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_wrong_values_name_their_option(
    arguments: list[str],
    option: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(monkeypatch, arguments) == 2
    assert option in one_line(capsys)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(28, "No space left on device"), "poil: No space left on device."),
        (OSError(28, "No space left on device", "a.mcap"), "poil: 'a.mcap': No space left"),
        (OSError("odd"), "poil: odd."),
        (InvalidValueError("One\nline.", remedy="Is enough."), "poil: One line. Is enough."),
    ],
)
def test_errors_of_the_system_end_in_one_line(
    error: Exception,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(**_: object) -> None:
        raise error

    monkeypatch.setattr("poil_drake.reports.doctor.Examine", fail)

    assert run(monkeypatch, ["doctor"]) == 1
    assert one_line(capsys).startswith(said)


def test_a_group_of_verbs_alone_shows_its_help(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["demo"]) == 2
    said = capsys.readouterr()
    assert "record" in said.out + said.err
    assert "poil:" not in said.err


def test_help_lists_the_verbs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["--help"]) == 0
    text = capsys.readouterr().out
    for verb in ("run", "demo", "transfer", "execute", "bench", "doctor"):
        assert verb in text


def test_options_of_the_control_study_arrive(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seen: dict[str, object] = {}
    monkeypatch.setattr(
        study, "run_control_study", lambda config, **options: seen.update(options, config=config)
    )
    monkeypatch.chdir(tmp_path)
    arguments = "--tasks pnp_cube,reshelving --policies field --trials 3 --no-hard --seed 5"
    others = "--jobs 2 --ray local --json a/b.json --pictures c"

    assert run(monkeypatch, ["bench", "control", *arguments.split(), *others.split()]) == 0

    assert seen["config"] == study.ControlStudyConfig(
        tasks=("pnp_cube", "reshelving"), policies=("field",), trials=3, hard=False, seed=5
    )
    del seen["config"]
    assert seen == {
        "json_path": Path("a/b.json"), "pictures": Path("c"), "jobs": 2, "ray_address": "local"
    }  # fmt: skip


def test_help_names_every_task_and_policy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "400")

    assert run(monkeypatch, ["bench", "control", "--help"]) == 0

    said = capsys.readouterr().out
    default = study.ControlStudyConfig()
    assert all(f"{name}" in said for name in (*default.tasks, *default.policies))


@pytest.mark.parametrize(("same", "status"), [(True, 0), (False, 1)])
def test_a_replay_ends_with_its_verdict(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], same: bool, status: int
) -> None:
    asked: list[tuple[Path, dict[str, object]]] = []

    class Summary:
        def __init__(self) -> None:
            self.same = same

        def closing_line(self) -> str:
            return "SAME OR NOT: a line."

    def replay(path: Path, **options: object) -> Summary:
        asked.append((path, options))
        return Summary()

    monkeypatch.setattr("poil_drake.diagrams.replay.replay.Replay", replay)
    options = ["--json", "a.json", "--png", "a.png", "--mcap", "a.mcap"]
    settings = ["--tracker", "recorded", "--scenario_text", "{poil: {eta: 2}}"]

    assert run(monkeypatch, ["replay", "run.mcap", *options, *settings]) == status

    assert capsys.readouterr().out == "SAME OR NOT: a line.\n"
    ((path, given),) = asked
    assert path == Path("run.mcap")
    assert given["outputs"] == OutputPaths(
        json=Path("a.json"), png=Path("a.png"), mcap=Path("a.mcap")
    )
    assert (given["tracker"], given["scenario_text"]) == ("recorded", "{poil: {eta: 2}}")
