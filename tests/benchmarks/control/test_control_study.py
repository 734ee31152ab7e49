import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from poil_drake.benchmarks.control import study as dut
from poil_drake.benchmarks.control.arena.direct_actuation import NO_SLIP
from poil_drake.benchmarks.control.arena.tasks import TASKS
from poil_drake.benchmarks.control.demonstration import TaskDemonstration
from poil_drake.benchmarks.control.point_policy.network import PointPolicyConfig
from poil_drake.benchmarks.control.trial import ControlTrial, RunTrial, TrialConfig
from poil_drake.benchmarks.trials.pool import LostTrial
from poil_drake.errors import InvalidValueError

SMALL = dut.ControlStudyConfig(tasks=("pnp_cube",), policies=("open_loop", "field"), trials=1)


def figures(path):
    return json.loads(path.read_text())


class Study(NamedTuple):
    """A study by two workers: its trials, its folder, and its output."""

    trials: list[ControlTrial]
    folder: Path
    printed: str


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    folder = tmp_path_factory.mktemp("study")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        trials = dut.run_control_study(
            SMALL, json_path=folder / "study.json", pictures=folder, jobs=2
        )
    return Study(trials, folder, printed.getvalue())


def test_results_do_not_depend_on_the_number_of_jobs(study, tmp_path):
    dut.run_control_study(SMALL, json_path=tmp_path / "one.json", jobs=1)

    assert figures(tmp_path / "one.json") == figures(study.folder / "study.json")


def test_study_covers_every_cell_and_prints_the_tables(study):
    cells = {(t.region, t.policy) for t in study.trials}
    assert cells == {
        *[(region, policy) for region in ("near", "far") for policy in SMALL.policies],
        *[("hard", policy) for policy in SMALL.policies],
    }
    assert "Success by the paper's criterion" in study.printed
    assert "Success without any collision" in study.printed
    assert "Hard mode" in study.printed
    near = [t for t in study.trials if t.region == "near" and t.policy == "field"]
    assert all(t.success and t.collision_free for t in near)
    assert (study.folder / "control_paths.png").exists()
    assert len(figures(study.folder / "study.json")["trials"]) == len(study.trials)


def test_figures_hold_the_settings_of_hard_mode(study):
    hard = figures(study.folder / "study.json")["hard"]
    assert hard["slip_distance"] == 0.03
    assert hard["tracking"]["noise"] == 0.003
    assert hard["trial"]["settled_time"] == 5.0


def test_trial_is_the_same_alone_and_after_others():
    hard = ({}, "mug_insertion", "hard", "safe_entry")
    alone = dut.run_control_trial(*hard, 1)
    dut.run_control_trial(*hard, 0)

    again = dut.run_control_trial(*hard, 1)

    assert alone.error == again.error
    np.testing.assert_array_equal(alone.path, again.path)


def test_study_runs_the_trials_of_its_seed(tmp_path):
    config = replace(SMALL, policies=("field",), hard=False, seed=3)

    near, _ = dut.run_control_study(config, json_path=tmp_path / "control.json")

    wanted = dut.run_control_trial({}, "pnp_cube", "near", "field", 0, seed=3)
    other = dut.run_control_trial({}, "pnp_cube", "near", "field", 0)
    np.testing.assert_array_equal(near.path, wanted.path)
    assert not np.array_equal(near.path[0], other.path[0])


def test_hard_trials_are_noisy_and_slip(monkeypatch):
    easy = dut.run_control_trial({}, "pnp_cube", "near", "field", 0)
    hard = dut.run_control_trial({}, "pnp_cube", "hard", "field", 0)
    monkeypatch.setattr(dut, "_draw_slip", lambda rng: NO_SLIP)
    held = dut.run_control_trial({}, "pnp_cube", "hard", "field", 0)

    assert easy.error < 0.001 < hard.error
    assert hard.success
    # Slips begin after one second at the earliest, after three at the latest, and move 3 cm.
    np.testing.assert_array_equal(hard.path[:9], held.path[:9])
    apart = np.linalg.norm(hard.path[:30] - held.path[:30], axis=1)
    assert 0.015 < apart.max() < 0.045


@pytest.mark.parametrize(
    ("task", "policy"),
    [
        *[(task, policy) for task in TASKS for policy in ("field", "safe_entry")],
        ("mug_insertion", "se3_bcsdm"),
        ("hanging_bag", "open_loop"),
    ],
)
def test_every_policy_repeats_the_demonstration_from_its_start(task, policy):
    shown = TaskDemonstration(task)

    trial = RunTrial(
        ControlTrial(task=task, region="near", policy=policy, trial=0),
        dut._arena(task, policy, False, None),
        shown,
        shown.X_WO[0],
        config=TrialConfig(),
    )

    assert trial.success
    assert trial.collision_free


def test_learned_policy_goes_through_the_study(tmp_path, monkeypatch):
    settings = PointPolicyConfig(steps=5)
    monkeypatch.setitem(dut.LEARNED, "pp_1", settings)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    trained = dut.train_policy("pnp_cube", "pp_1")
    trial = dut.run_control_trial({("pnp_cube", "pp_1"): trained}, "pnp_cube", "near", "pp_1", 0)

    assert trained.config == settings
    assert np.isfinite(trial.error)
    assert trial.note == ""


def test_trial_that_an_error_ends_is_a_failure_with_its_distance(monkeypatch):
    expected = dut.run_control_trial({}, "pnp_cube", "far", "field", 1)
    monkeypatch.setattr(dut, "RunTrial", lambda *_, **__: 1 / 0)

    trial = dut.run_control_trial({}, "pnp_cube", "far", "field", 1)

    assert trial.lost
    assert not trial.success
    assert not trial.collision_free
    assert trial.note.startswith("ZeroDivisionError")
    assert trial.distance == expected.distance > 0.0


def test_figures_so_far_are_written_periodically(tmp_path, monkeypatch):
    path = tmp_path / "study.json"
    counts = []

    def inspect(function, arguments, *, shared, **options):
        for index, one in enumerate(arguments):
            counts.append(len(figures(path)["trials"]) if path.exists() else 0)
            yield index, function(*shared, *one)

    monkeypatch.setattr(dut, "run_trials", inspect)
    monkeypatch.setattr(dut, "_WRITING_PERIOD", 0.0)

    dut.run_control_study(replace(SMALL, policies=("field",), hard=False), json_path=path)

    assert counts == [0, 1]


def test_interrupted_study_leaves_the_figures_so_far(tmp_path, monkeypatch):
    def interrupted(function, arguments, *, shared, **options):
        yield 0, function(*shared, *arguments[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(dut, "run_trials", interrupted)
    path = tmp_path / "study.json"

    with pytest.raises(KeyboardInterrupt):
        dut.run_control_study(SMALL, json_path=path)

    assert len(figures(path)["trials"]) == 1
    assert [p.name for p in tmp_path.iterdir()] == ["study.json"]


def test_trial_that_lost_its_workers_is_a_failure(tmp_path, monkeypatch):
    def dying(function, arguments, *, shared, **options):
        for index, one in enumerate(arguments):
            yield index, LostTrial(index, one, 3, "status -9")

    monkeypatch.setattr(dut, "run_trials", dying)

    trials = dut.run_control_study(SMALL, json_path=tmp_path / "study.json")

    assert not any(trial.success for trial in trials)
    assert "status -9" in trials[0].note


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tasks": ("juggling",)}, "task 'juggling'"),
        ({"policies": ("luck",)}, "policy 'luck'"),
        ({"policies": ("field", "field")}, "policy is named twice"),
    ],
)
def test_unknown_or_repeated_names_are_rejected(changes, words):
    with pytest.raises(InvalidValueError, match=words):
        dut.ControlStudyConfig(**changes)
