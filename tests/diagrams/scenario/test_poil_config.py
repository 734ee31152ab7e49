import math
import time

import pytest

from poil_drake.diagrams.run.planning import _planner_config
from poil_drake.diagrams.scenario.hardware_config import HardwareConfig
from poil_drake.diagrams.scenario.load import ChooseScenario
from poil_drake.diagrams.scenario.poil_config import Rates
from poil_drake.errors import PoilError, ScenarioError


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speed", 0.0),
        ("speed", 1.01),
        ("speed", float("nan")),
        ("time_scale", 2.0),
        ("command_expiry", -0.1),
        ("ready_timeout", float("inf")),
        ("realtime_priority", 100),
    ],
)
def test_values_out_of_range_are_named(field: str, value: float) -> None:
    with pytest.raises(ScenarioError, match=f"poil.hardware.{field} is"):
        HardwareConfig(**{field: value})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("hardware: {channels: {status: ''}}", "status is '', which is not a valid LCM channel"),
        (f"hardware: {{channels: {{command: {'A' * 64}}}}}", "channels.command is 'AAA"),
        ("hardware: {channels: {status: A, command: A}}", "channels.command and .status are both"),
        (f"hardware: {{cameras: {{a: !LcmImages {{channel: {'A' * 64}}}}}}}", "a.channel is 'AAA"),
        ("hardware: {command_expiry: 0.05}", "stall_limit is 0.08 s, not less .*expiry, 0.05 s"),
        ("safety: {posture: {table_height: 0.05}}", "table_height is 0.05 m, but"),
        ("safety: {stall_limit: -1}", "^poil.safety.stall_limit is -1"),
        ("grasp: {seed_points: 0}", "^poil.grasp.seed_points is 0"),
        ("grasp: {approach_angle: 90}", "^poil.grasp.approach_angle is 90.0.* at most 1.57"),
        ("clearance: {robot_margin: -0.01}", "^poil.clearance.robot_margin is -0.01"),
        ("fusion: {mask: {erosion: -1}}", "^poil.fusion.mask.erosion is -1"),
        ("fusion: {mask: {max_depth: 0.05}}", "max_depth is 0.05 m, not more than min_depth"),
        ("clearance: {ground_height: 0.1}", "'ground_height' in 'poil.clearance' is not known"),
    ],
)
def test_contradictory_settings_are_refused(text: str, says: str) -> None:
    with pytest.raises(PoilError, match=says):
        ChooseScenario(data=f"{{poil: {{{text}}}}}")


def test_settings_of_grasps_and_clearances_reach_the_planner() -> None:
    text = "grasp: {seed_points: 9}, clearance: {object_margin: 0.001}, table_height: 0.1"

    dut = _planner_config(ChooseScenario(data=f"{{poil: {{{text}}}}}").poil)

    assert dut.sampling.seed_points == 9
    assert dut.feasibility.collision.object_margin == 0.001
    assert dut.feasibility.collision.ground_height == 0.1


def test_the_same_table_height_can_be_given_twice() -> None:
    text = "{poil: {table_height: 0.05, safety: {posture: {table_height: 0.05}}}}"

    assert ChooseScenario(data=text).poil.safety.posture.table_height == 0.05


def test_the_steady_clock_ignores_the_system_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "time", lambda: 2000.0)
    monkeypatch.setattr(time, "monotonic", lambda: 30.0)
    clock = HardwareConfig(time_scale=0.5).steady_clock()
    assert clock() == 0.5 * 2000.0

    monkeypatch.setattr(time, "time", lambda: 1000.0)
    monkeypatch.setattr(time, "monotonic", lambda: 31.0)

    assert clock() == 0.5 * 2001.0


@pytest.mark.parametrize(("scale", "duration"), [(1.0, 10.0), (0.5, 5.0)])
def test_a_scaled_clock_runs_slower(
    monkeypatch: pytest.MonkeyPatch, scale: float, duration: float
) -> None:
    monkeypatch.setattr(time, "time", iter([1000.0, 1010.0]).__next__)
    clock = HardwareConfig(time_scale=scale).clock()

    assert -clock() + clock() == duration


def test_the_command_line_overrides_the_scenario() -> None:
    scenario = ChooseScenario(data="{poil: {hardware: {speed: 0.5}}}", speed=0.3, time_scale=0.25)

    assert scenario.poil.hardware.speed == 0.3
    assert scenario.poil.hardware.time_scale == 0.25


@pytest.mark.parametrize(
    ("periods", "says"),
    [
        ({"control": 1 / 300}, "control is"),
        # 50 times 0.002 is 0.1 in print only: the floating-point numbers drift apart.
        ({"plant": 0.002, "control": 0.002, "tracker": 0.1, "logger": 0.002}, "tracker is"),
        ({"logger": 1 / 512}, "logger is"),
        ({"plant": 0.0}, "plant is"),
        ({"control": math.inf}, "control is inf"),
        ({"logger": math.nan}, "logger is nan"),
        ({"tracker": -1 / 8}, "tracker is"),
    ],
)
def test_periods_that_do_not_divide_are_refused(periods: dict[str, float], says: str) -> None:
    with pytest.raises(ScenarioError, match=f"poil.rates.{says}"):
        Rates(**periods)


def test_a_report_follows_every_log_and_every_capture() -> None:
    dut = Rates(tracker=3 / 32, logger=1 / 16)

    times = [0.0]
    while times[-1] < 0.25:
        times.append(dut.next_report(times[-1]))

    assert times == [0.0, 2 / 32, 3 / 32, 4 / 32, 6 / 32, 8 / 32]


def test_reports_do_not_drift_from_captures() -> None:
    # 0.02 is not exact in binary: adding it up misses whole multiples from the third on.
    dut = Rates(plant=0.005, control=0.005, tracker=0.08, logger=0.02)

    time, times = 0.0, set()
    for _ in range(4000):
        time = dut.next_report(time)
        times.add(time)

    assert len(times) == 4000
    assert {k * 0.08 for k in range(1, 1000)} <= times
