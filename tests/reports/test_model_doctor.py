import importlib.metadata
from pathlib import Path

import pytest

from poil_drake.perception.learned_models.learned_model import LearnedModel
from poil_drake.reports.finding import Finding
from poil_drake.reports.model_doctor import model_findings, tracker_findings


def findings() -> dict[str, Finding]:
    return {finding.name: finding for finding in model_findings()}


def test_missing_weights_come_with_the_command_and_the_licence() -> None:
    found = findings()

    for name, remedy in (
        ("GroundingDino", "or run: hf download IDEA-Research/grounding-dino-base"),
        ("RexOmni", "(research only) and run: hf download IDEA-Research/Rex-Omni"),
        ("Sam3", "accept the SAM License and run: hf download facebook/sam3"),
        ("Sam2", "or run: hf download facebook/sam2.1-hiera-large"),
    ):
        assert found[name].ok  # They are optional.
        assert found[name].found.endswith(remedy)


def test_present_weights_come_with_their_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LearnedModel, "folder", lambda self: Path("/models"))

    assert findings()["Sam2"].found == "weights in /models"


def test_without_transformers_the_command_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", fail)

    [finding] = findings().values()

    assert finding.ok
    assert "pip install 'poil_drake[vision]'" in finding.found


def test_learned_trackers_come_with_the_commands_that_install_them() -> None:
    found = {finding.name: finding for finding in tracker_findings()}

    assert list(found) == ["MVTracker", "CoTracker3"]
    assert found["MVTracker"].ok  # They are optional.
    assert "git clone https://github.com/ethz-vlg/mvtracker " in found["MVTracker"].found
    assert "scaled_online.pth" in found["CoTracker3"].found
