"""User mistakes on the command line end in one readable line and a non-zero status."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from poil_drake import cli


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
        (["run", "--scenario_text", "{poil: {part: spout}}"], "'spout'"),
        (["run", "--scenario_text", "{poil: {eta: -1}}"], "eta"),
        (["run", "--scenario_text", "{poil: ["], "not valid YAML"),
        (["run", "--hardware"], "hardware"),
        (["demo", "show", "missing.mcap"], "missing.mcap"),
        (["transfer", "missing.mcap"], "missing.mcap"),
        (["execute", "missing.npz"], "missing.npz"),
        (["bench", "pipeline", "--tasks", "juggle"], "'juggle'"),
        (
            ["run", "--json", "/dev/null/x.json", "--scenario_text", "{poil: {part: x}}"],
            "/dev/null",
        ),
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


def test_unknown_options_name_the_usage(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["run", "--speed", "9"]) == 2
    assert "No such option" in one_line(capsys)


def test_help_lists_the_verbs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, ["--help"]) == 0
    text = capsys.readouterr().out
    for verb in ("run", "demo", "transfer", "execute", "bench", "doctor"):
        assert verb in text
