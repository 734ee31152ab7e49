import json

import numpy as np
import pytest

from poil_drake.benchmarks.control import study as dut
from poil_drake.errors import InvalidValueError

SMALL = dut.ControlStudyConfig(tasks=("pnp_cube",), policies=("open_loop", "field"), trials=2)


def figures(path):
    return json.loads(path.read_text())


def test_results_do_not_depend_on_the_number_of_jobs(tmp_path):
    one, two = tmp_path / "one.json", tmp_path / "two.json"

    dut.run_control_study(SMALL, json_path=one, jobs=1)
    dut.run_control_study(SMALL, json_path=two, jobs=2)

    assert figures(one) == figures(two)


def test_study_covers_every_cell_and_prints_the_tables(tmp_path, capsys):
    path = tmp_path / "study.json"

    trials = dut.run_control_study(SMALL, json_path=path, pictures=tmp_path, jobs=2)

    cells = {(t.region, t.policy) for t in trials}
    assert cells == {
        *[(region, policy) for region in ("near", "far") for policy in SMALL.policies],
        ("hard", "field"),
    }
    printed = capsys.readouterr().out
    assert "Success by the paper's criterion" in printed
    assert "Success without any collision" in printed
    assert "Hard mode" in printed
    near = [t for t in trials if t.region == "near" and t.policy == "field"]
    assert all(t.success and t.collision_free for t in near)
    assert (tmp_path / "control_paths.png").exists()
    assert len(figures(path)["trials"]) == len(trials)


def test_trial_is_the_same_alone_and_after_others():
    alone = dut.run_control_trial({}, "pnp_cube", "far", "field", 1)
    dut.run_control_trial({}, "pnp_cube", "far", "field", 0)

    again = dut.run_control_trial({}, "pnp_cube", "far", "field", 1)

    assert alone.error == again.error
    np.testing.assert_array_equal(alone.path, again.path)


def test_hard_trials_slip_and_are_noisy():
    easy = dut.run_control_trial({}, "pnp_cube", "near", "field", 0)
    hard = dut.run_control_trial({}, "pnp_cube", "hard", "field", 0)

    assert easy.error < 0.001 < hard.error
    assert hard.success


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"tasks": ("juggling",)}, "task 'juggling'"), ({"policies": ("luck",)}, "policy 'luck'")],
)
def test_unknown_names_are_refused_with_those_there_are(changes, words):
    with pytest.raises(InvalidValueError, match=words):
        dut.ControlStudyConfig(**changes)
