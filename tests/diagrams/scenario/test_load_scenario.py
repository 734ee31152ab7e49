from pathlib import Path

import numpy as np
import pytest

from poil_drake.diagrams.scenario.load import LoadScenario, default_scenario_file
from poil_drake.diagrams.scenario.scenario import Scenario
from poil_drake.errors import ScenarioError

TEST_FILE = Path(__file__).parents[1] / "scenarios.yaml"


def test_the_default_file_hangs_a_mug() -> None:
    dut = LoadScenario(filename=default_scenario_file())

    assert dut.poil.object == "mug"
    assert list(dut.cameras) == ["left", "right"]
    assert dut.cameras["right"].width == 640
    assert len([d for d in dut.directives if d.add_model]) == 4


def test_what_is_infinite_by_default_may_be_infinite() -> None:
    region = "!PartRegion {lower: [0.1, -.inf, -.inf]}"
    data = f"{{simulation_duration: .inf, poil: {{parts: {{handle: {region}}}}}}}"

    dut = LoadScenario(data=data, defaults=LoadScenario(data="{simulation_duration: 3}"))

    assert dut.simulation_duration == np.inf
    assert dut.poil.parts["handle"].lower == (0.1, -np.inf, -np.inf)


def test_an_empty_scenario_has_the_defaults() -> None:
    dut = LoadScenario(filename=TEST_FILE, scenario_name="Defaults")

    assert dut.poil == Scenario().poil
    assert dut.directives == []


def test_every_key_is_read() -> None:
    dut = LoadScenario(filename=TEST_FILE, scenario_name="OneOfEverything")

    assert dut.random_seed == 7
    assert dut.simulation_duration == 0.0625
    assert dut.simulator_config.max_step_size == 0.01
    assert dut.model_drivers["panda"].expire_sec == 0.05
    assert dut.cameras["front"].focal.y == 50
    assert dut.cameras["front"].renderer_class.backend == "EGL"
    assert dut.initial_position["panda"]["panda_joint2"] == np.array([-0.5])
    assert dut.poil.parts == {"grip": "grip_.*"}
    assert dut.poil.latency == 1 / 32
    assert dut.poil.depth_noise.quadratic == 0.002
    assert dut.poil.rates.tracker == 1 / 8
    assert dut.poil.randomization.yaw == (-90, 90)


def test_paths_are_relative_to_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    dut = LoadScenario(filename=TEST_FILE, scenario_name="OneOfEverything")

    cup = f"file://{TEST_FILE.resolve().parent / 'own_cup.xml'}"
    assert dut.directives[-1].add_model.file == cup
    assert dut.poil.randomization.models[1] == cup
    assert dut.poil.demonstration == str(TEST_FILE.resolve().parent / "own_demo.mcap")


def test_paths_in_text_are_relative_to_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    cameras = "{cameras: {top: !McapPlayback {file: b.mcap}}}"
    dut = LoadScenario(data=f"{{poil: {{demonstration: a.mcap, hardware: {cameras}}}}}").poil

    assert dut.demonstration == str(tmp_path / "a.mcap")
    assert dut.hardware.cameras["top"].file == str(tmp_path / "b.mcap")


def test_text_overrides_single_values_of_the_file() -> None:
    plain = LoadScenario(filename=default_scenario_file())

    dut = LoadScenario(
        filename=default_scenario_file(),
        data="{poil: {eta: 2, rates: {tracker: 1/4}}, cameras: {left: {width: 320}}}",
    )

    assert dut.poil.eta == 2.0
    assert dut.poil.rates.tracker == 1 / 4
    assert dut.poil.rates.control == plain.poil.rates.control
    assert dut.cameras["left"].width == 320
    assert dut.cameras["left"].height == plain.cameras["left"].height
    assert dut.cameras["right"].width == 640


def test_defaults_are_merged_but_not_changed() -> None:
    defaults = LoadScenario(data="{random_seed: 5, poil: {eta: 1.5}}")

    dut = LoadScenario(data="{poil: {num_points: 12}}", defaults=defaults)

    assert (dut.random_seed, dut.poil.eta, dut.poil.num_points) == (5, 1.5, 12)
    assert defaults.poil.num_points == 10


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{poil: {objct: mug}}", "'objct' in 'poil'.*Did you mean 'object'.*Valid keys: object"),
        ("{polt: {}}", "'polt' is not known.*Valid keys: random_seed"),
        ("{cameras: {left: {widt: 3}}}", "'widt' in 'cameras.left'.*'width'"),
        ("{cameras: {left: {focal: !FovDegrees {z: 1}}}}", "'z' in 'cameras.left.focal'"),
        ("{directives: [{add_modl: {}}]}", r"'add_modl' in 'directives\[0\]'.*'add_model'"),
        ("{poil: {rates: {tracker: 0.3}}}", "poil.rates.tracker is 0.3 s"),
        ("{poil: {rates: {tracker: 1/0}}}", "'poil.rates.tracker' is '1/0'"),
        ("{poil: {eta: fast}}", "'poil.eta' is 'fast'"),
        (f"{{poil: {{eta: 1{'0' * 400}}}}}", "'poil.eta' is 1000"),
        ("{poil: {eta: -1}}", "poil.eta is -1.*must be positive"),
        ("{poil: {num_points: 2}}", "at least 3"),
        ("{poil: {latency: -0.5}}", "poil.latency is -0.5.*not negative"),
        (
            "{poil: {latency: 0.1}, cameras: {left: {name: left, output_delay: 0.1}}}",
            "latency is 0.1 s, less .* cameras.left.output_delay and .*, 0.1039.*at least",
        ),
        ("{poil: {parts: handle}}", "'poil.parts' is 'handle'.*mapping"),
        ("{poil: {depth_noise: {hole_probability: 3}}}", "^poil.depth_noise.hole_probability is 3"),
        ("{poil: {randomization: {x: [1]}}}", r"randomization.x.*\[lowest, highest\]"),
        ("{poil: {randomization: {models: mug}}}", "'poil.randomization.models' is 'mug'"),
        ("{random_seed: [1]}", "'random_seed' is"),
        ("[1", "not valid YAML"),
        ("[1]", "mapping"),
        ("mug", "'the scenario' is 'mug'.*mapping"),
        ("{3: 4}", "a key that is not text .* at line 1"),
        ("{poil: {eta: 1}, poil: {eta: 2}}", "'poil' occurs twice at line 1"),
        ("{random_seed: -1}", "random_seed is -1.*not negative"),
        ("{simulation_duration: 0}", "simulation_duration is 0"),
        ("{poil: {randomization: {x: [1, 0]}}}", "randomization.x is"),
        ("{poil: {randomization: {x: [0, .inf]}}}", r"randomization.x' is \[0, inf\]"),
        ("{model_drivers: {panda: {stiffness: [1, 2]}}}", "panda.stiffness .*2 values.*Set 7"),
        (
            "{model_drivers: {panda: !IiwaDriver {}}}",
            "'!IiwaDriver', but a mapping .PandaDriver.",
        ),
        ("{model_drivers: {hand: !SchunkWsgDriver {}}}", "hand' is '!SchunkWsgDriver', .*Panda"),
        ("{model_drivers: {mug: !ZeroForceDriver {}}}", "mug' is '!ZeroForceDriver', .*Panda"),
        ("{camera_ids: {left: LEFT}}", "'camera_ids' is not known"),
        (
            "{scene_graph_config: {default_proximity_properties: {resolution_hint: 1e-6}}}",
            "resolution_hint is 1e-06 m, which is out of range. .* at least 0.001 m",
        ),
        ("{model_drivers: {panda: {leash: -1}}}", "^model_drivers.panda.leash is -1"),
        ("{cameras: {left: }}", "'cameras.left' is None"),
        ("{cameras: {left: {width: 1.5}}}", "'cameras.left.width' is 1.5, but a whole number is"),
        (
            "{cameras: {left: {X_PB: {translation: [1, 2]}}}}",
            r"'cameras.left.X_PB.translation' is \[1, 2\], but a list of 3 numbers",
        ),
        (
            "{cameras: {left: {X_PB: {translation: !Uniform {min: [1, 2, 3]}}}}}",
            "X_PB.translation' is '!Uniform', but a list of finite numbers or a mapping with one "
            "of the tags !DeterministicVector, !GaussianVector, !UniformVector is needed",
        ),
        (
            "{cameras: {left: {X_PB: {translation: !UniformVector {min: [1, 2], max: [3, 4]}}}}}",
            r"X_PB.translation.min' is \[1, 2\], but a list of 3 numbers",
        ),
        (
            "{cameras: {left: {renderer_class: 3}}}",
            "renderer_class' is 3, but text .* or a mapping with one of the tags !RenderEngineVtk",
        ),
        ("{cameras: {left: {renderer_class: {a: 1}}}}", "renderer_class' is {'a': 1}, but text "),
        ("{directives: 3}", "'directives' is 3, but a list is needed"),
        ("{cameras: {left: {lcm_bus: lab}}}", "cameras.left.lcm_bus is 'lab'.*Choose one of: def"),
        ("{visualization: {lcm_bus: lab}}", "visualization.lcm_bus is 'lab'"),
        ("{visualization: {publish_period: 0}}", "visualization.publish_period is 0"),
        (
            "{poil: {hardware: {cameras: {left: !Kinect {}}}}}",
            "hardware.cameras.left' is '!Kinect', but .* one of the tags !LcmImages, !RealSense, ",
        ),
        (
            "{poil: {hardware: {cameras: {left: 3}}}}",
            "hardware.cameras.left' is 3, but a mapping with one of the tags !LcmImages, ",
        ),
        (
            "{poil: {hardware: {cameras: {left: !RealSense {serial: 1}}}}}",
            r"left.serial' is 1, but text \(in quotes if it looks like a number\) is needed",
        ),
        ("{lcm_buses: {default: {lcm_url: 'ros://x'}}}", "lcm_url is 'ros://x'"),
        ("{lcm_buses: {lab: {lcm_url: 'udpm://hello'}}}", "buses.lab.lcm_url is 'udpm://hello'"),
        ("{lcm_buses: {lab: {lcm_url: 'udpm://239.255.76.67:99999'}}}", "lcm_buses.lab.lcm_url is"),
        ("{lcm_buses: {lab: {lcm_url: 'udpm://10.0.0.1:7667'}}}", "lcm_buses.lab.lcm_url is"),
        (
            "{poil: {disturbances: [{body: 'mug::body', start: 1}]}}",
            r"ances\[0\]' has no 'duration'",
        ),
        (
            "{poil: {disturbances: [{body: 'mug::body', start: 1, duration: 0}]}}",
            r"poil.disturbances\[0\]: The duration of the pulse on 'mug::body' is 0.0 s",
        ),
        ("{poil: {parts: {'': body}}}", "A key of poil.parts is empty"),
        ("{directives: [{add_model: mug}]}", r"add_model' is 'mug', but a mapping \(AddModel\)"),
        ("{plant_config: {time_step: 0.1}}", "time_step is 0.1 s, but poil.rates.plant"),
        ("{simulator_config: {integration_scheme: euler}}", "'euler' is not.*runge_kutta3"),
        ("{simulator_config: {max_step_size: -1}}", "max_step_size is -1"),
        ("{simulator_config: {accuracy: 0}}", "accuracy is 0"),
        ("{simulator_config: {target_realtime_rate: -1}}", "target_realtime_rate is -1"),
        ("{simulator_config: {start_time: 3}}", "start_time is 3"),
        ("{directives: [{}]}", r"'directives\[0\]' holds nothing"),
        ("{directives: [3]}", r"'directives\[0\]' is 3"),
        ("{directives: [{add_model: {name: a}}]}", r"'directives\[0\].add_model' has no 'file'"),
        (
            "{directives: [{add_model: {name: a, file: a.sdf}, add_weld: {parent: b, child: c}}]}",
            "holds add_model and add_weld.*own dash",
        ),
        (
            "{poil: {demonstration_motion: {keyframes: [{time: 0}, {time: .nan}]}}}",
            r"keyframes\[1\].time' is nan",
        ),
        ("{poil: {demonstration_motion: {keyframes: [{time: 0}]}}}", "at least two"),
        (
            "{poil: {demonstration_motion: {keyframes: [{time: 0}, {time: 2}, {time: 1}]}}}",
            r"keyframes are not valid: \[0.0, 2.0, 1.0\] s",
        ),
        (
            "{poil: {demonstration_motion: {keyframes: [{time: 0.5}, {time: 1}]}}}",
            "the first at 0",
        ),
        ("{poil: {demonstration_motion: {blend: -1}}}", "blend is -1"),
        ("{poil: {demonstration_motion: {hanging: {lift: -1}}}}", "hanging.lift is -1"),
        ("{poil: {demonstration_motion: {hanging: {seat: 2}}}}", "hanging.seat is 2"),
        ("{poil: {table_height: .nan}}", "'poil.table_height' is nan, but a finite number"),
        ("{poil: {table_height: .inf}}", "'poil.table_height' is inf, but a finite number"),
        ("{simulation_duration: .nan}", "'simulation_duration' is nan"),
        (
            "{poil: {demonstration_motion: {hanging: {start: [0, -.inf]}}}}",
            r"hanging.start' is \[0, -inf\]",
        ),
        (
            "{poil: {demonstration_parts: {handel: grip}}}",
            "names the part 'handel', .* Choose one of: handle",
        ),
        ("{initial_position: {panda: {panda_joint1: [.nan]}}}", r"panda_joint1' is \[nan\]"),
    ],
)
def test_mistakes_are_named_in_one_line(text: str, says: str) -> None:
    with pytest.raises(ScenarioError, match=says) as info:
        LoadScenario(data=text)

    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    ("filename", "name", "says"),
    [
        ("/no/such.yaml", None, r"'/no/such.yaml' cannot be read.*hang_mug.yaml"),
        (TEST_FILE.parent, None, r"cannot be read.*directory"),
        (TEST_FILE, "HangCup", r"'HangCup'.*Defaults, OneOfEverything"),
        (TEST_FILE, None, r"'HangMug'.*Defaults, OneOfEverything"),
    ],
)
def test_a_file_or_scenario_that_does_not_exist_is_named(
    filename: str | Path, name: str | None, says: str
) -> None:
    with pytest.raises(ScenarioError, match=says):
        LoadScenario(filename=filename, scenario_name=name)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "holds no scenarios"),
        (b"- HangMug\n", "holds no scenarios"),
        (b"HangMug", "holds no scenarios"),
        (b"\xff\xfe\x00H", "not text in UTF-8"),
        (b"HangMug: \x00", "not valid YAML"),
        (b"directives: []\npoil: {}\n", "begins with the keys of a scenario"),
        (b"HangMug: [1]\n", "mapping"),
        (b"HangMug: {}\nHangMug: {}\n", "'HangMug' occurs twice at line 2"),
        (b"1: {}\n", "not text.* at line 1"),
    ],
)
def test_an_invalid_scenario_file_is_refused(content: bytes, says: str, tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_bytes(content)

    with pytest.raises(ScenarioError, match=says) as info:
        LoadScenario(filename=path)

    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    "url", ["", "memq://null", "udpm://239.255.76.67:7667?ttl=0", "udpm://", "tcpq://", "memq://"]
)
def test_valid_lcm_addresses_are_accepted(url: str) -> None:
    dut = LoadScenario(data=f"{{lcm_buses: {{lab: {{lcm_url: '{url}'}}}}}}")

    assert dut.lcm_buses["lab"].lcm_url == url


def test_anchors_can_be_reused_and_overridden() -> None:
    dut = LoadScenario(
        data="cameras: {a: &a {name: a, width: 32}, b: {<<: *a, name: b, height: 24}}"
    )

    assert (dut.cameras["b"].name, dut.cameras["b"].width, dut.cameras["b"].height) == ("b", 32, 24)


def test_a_file_that_is_too_long_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "long.yaml"
    path.write_text("HangMug:\n" + "# nothing\n" * 110_000)

    with pytest.raises(ScenarioError, match="more than 1000000 characters"):
        LoadScenario(filename=path)


# Ten lines of ten aliases each stand for 10^10 values.
TENFOLD = [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]


@pytest.mark.parametrize(
    "text", ["\n".join(["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]", *TENFOLD]), "a: &a [*a]"]
)
def test_aliases_that_stand_for_too_many_values_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match=r"more than 100000 values.*alias may contain itself"):
        LoadScenario(data=text)
