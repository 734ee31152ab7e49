"""The help texts of the command line and the Makefile."""

import re
import subprocess
from importlib.metadata import version
from pathlib import Path

import pytest
from command_line import Command
from python_process import run_python

from poil_drake.reports.run_summary import RunSummary, RunTiming

ROOT = Path(__file__).parents[2]
VERBS = ["doctor", "run", "demo", "label", "transfer", "execute", "replay", "calibrate"]
VERBS += ["driver", "bench"]


def test_help_lists_the_verbs_in_the_order_of_work_with_a_line_each(command: Command) -> None:
    text = command("--help").out

    rows = re.findall(r"^│ (\w+) +([A-Z].*\.) +│$", text, flags=re.MULTILINE)
    assert [verb for verb, _ in rows] == VERBS
    assert "poil --install-completion" in text


def test_the_versions_are_printed(command: Command) -> None:
    dut = command("--version")

    assert dut.out == f"poil_drake {version('poil-drake')}, Drake {version('drake')}\n"


def test_the_shell_completes_verbs_without_loading_drake() -> None:
    script = """
import os, sys
os.environ.update(_POIL_COMPLETE="complete_bash", COMP_WORDS="poil tr", COMP_CWORD="1")
sys.argv = ["poil"]
from poil_drake.cli import main
try:
    main()
finally:
    print("pydrake" in sys.modules or "torch" in sys.modules)
"""
    assert run_python("-c", script).split() == ["transfer", "False"]


def test_the_help_of_a_run_says_where_its_outputs_will_be(command: Command) -> None:
    text = command("run", "--help").out

    for name in ("html", "mcap", "png", "json"):
        assert re.search(rf"--{name} .*Default: out/run\.{name}\.", text)


def test_a_run_ends_with_the_places_of_its_outputs(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    summary = RunSummary(
        success=True,
        reason="it hangs",
        timing=RunTiming(simulated=1.0, wall=1.0),
        outputs={"html": "a.html", "mcap": "out/run.mcap", "json": "out/run.json"},
    )
    monkeypatch.setattr("poil_drake.diagrams.run.skill_run.RunSkill", lambda *_, **__: summary)

    lines = command("run").out.splitlines()

    assert [line.split(maxsplit=1) for line in lines[:-1]] == [
        ["recording", "a.html"],
        ["log", "out/run.mcap"],
        ["figures", "out/run.json"],
        ["plan", "plan.npz in out/run.mcap"],
    ]
    assert lines[-1] == summary.closing_line()


def test_make_lists_every_target() -> None:
    makefile = (ROOT / "Makefile").read_text()
    (targets,) = re.findall(r"^\.PHONY: (.*)$", makefile, flags=re.MULTILINE)

    listings = [
        subprocess.run(["make", *target], cwd=ROOT, capture_output=True, text=True).stdout
        for target in ([], ["help"])
    ]

    assert listings[0] == listings[1]
    listed = re.findall(r"^make (\w+)", listings[0], flags=re.MULTILINE)
    assert sorted(listed) == sorted(targets.split())
