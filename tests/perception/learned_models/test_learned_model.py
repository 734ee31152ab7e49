import importlib.util
import logging
from pathlib import Path

import pytest

from poil_drake.errors import InvalidValueError, MissingDependencyError
from poil_drake.perception.detectors.by_name.config import GroundingDino, RexOmni, Sam3
from poil_drake.perception.learned_models import learned_model


def test_weights_may_be_in_any_folder(tmp_path: Path) -> None:
    for name in ("config.json", "model.safetensors"):
        (tmp_path / name).touch()

    assert GroundingDino(weights=str(tmp_path)).folder() == tmp_path


@pytest.mark.parametrize(
    ("model", "remedy"),
    [
        (GroundingDino(), "or run: hf download IDEA-Research/grounding-dino-base"),
        (
            GroundingDino(weights="/no/such/folder"),
            "or run: hf download IDEA-Research/grounding-dino-base",
        ),
        (Sam3(), "accept the SAM License and run: hf download facebook/sam3"),
    ],
)
def test_missing_weights_are_named_with_the_command_that_gets_them(
    model: GroundingDino | Sam3, remedy: str
) -> None:
    with pytest.raises(MissingDependencyError, match="not found") as raised:
        model.folder()

    assert f"'{model.weights}'" in raised.value.problem
    assert raised.value.remedy.endswith(remedy)


def test_weights_without_their_configuration_are_incomplete(tmp_path: Path) -> None:
    (tmp_path / "model.safetensors").touch()

    with pytest.raises(MissingDependencyError, match=r"incomplete.*lacks config\.json"):
        GroundingDino(weights=str(tmp_path)).folder()


def test_without_transformers_the_error_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)

    with pytest.raises(MissingDependencyError, match=r"pip install 'poil_drake\[vision\]'"):
        GroundingDino().folder()


@pytest.mark.parametrize("model", [RexOmni(), Sam3()])
def test_a_licence_with_terms_must_be_accepted(model: RexOmni | Sam3) -> None:
    with pytest.raises(InvalidValueError, match="accept_licence is false") as raised:
        model.check_licence()

    assert model.licence.name in str(raised.value)


def test_a_licence_that_forbids_commercial_use_is_logged_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    learned_model._warn_once.cache_clear()

    with caplog.at_level(logging.WARNING):
        for device in ("cpu", "cuda"):
            RexOmni(accept_licence=True, device=device).check_licence()
        for model in (Sam3(accept_licence=True), GroundingDino()):
            model.check_licence()

    [record] = caplog.records
    assert "RexOmni are not for commercial use: IDEA License" in record.message
