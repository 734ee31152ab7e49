"""Where a learned model's weights are, and under which licence they may be used."""

import importlib.util
import logging
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import ClassVar

from poil_drake.errors import InvalidValueError, MissingDependencyError


@dataclass(frozen=True, kw_only=True)
class Licence:
    """The licence of a model's weights.

    Attributes:
        name: The licence's name.
        permissive: Whether the weights may be used without accepting terms.
        commercial: Whether the weights may be used commercially.
    """

    name: str
    permissive: bool
    commercial: bool


APACHE = Licence(name="Apache License 2.0", permissive=True, commercial=True)


@dataclass(frozen=True, kw_only=True)
class LearnedModel:
    """A model whose weights the user obtains. Nothing is downloaded at run time.

    Attributes:
        weights: A folder with the weights, or their name on Hugging Face after `hf download NAME`.
        device: The torch device that runs the model, e.g. "cuda:1"; empty for a GPU if there is
            one, otherwise the CPU.
        accept_licence: Whether the user accepts the licence of the weights.
    """

    licence: ClassVar[Licence] = APACHE

    weights: str = ""
    device: str = ""
    accept_licence: bool = False

    def folder(self) -> Path:
        """Returns the folder that holds the weights.

        Raises:
            MissingDependencyError: if transformers is not installed, or the weights are not found.
        """
        if importlib.util.find_spec("transformers") is None:
            raise MissingDependencyError(
                f"transformers, which runs {type(self).__name__}, is not installed.",
                remedy="Run: pip install 'poil_drake[vision]'",
            )
        from huggingface_hub import snapshot_download
        from huggingface_hub.errors import HFValidationError, LocalEntryNotFoundError

        folder = Path(self.weights).expanduser()
        if not folder.is_dir():
            try:
                folder = Path(snapshot_download(self.weights, local_files_only=True))
            except (HFValidationError, LocalEntryNotFoundError) as error:
                raise self._missing("were not found") from error
        if not (folder / "config.json").is_file() or not any(folder.glob("*.safetensors")):
            raise self._missing(f"are incomplete: {folder} lacks config.json or *.safetensors")
        return folder

    def check_licence(self) -> None:
        """Checks that the licence is accepted, and logs once if it forbids commercial use.

        Raises:
            InvalidValueError: if the licence must be accepted first.
        """
        name = type(self).__name__
        if not (self.licence.permissive or self.accept_licence):
            raise InvalidValueError(
                f"{name}.accept_licence is false, but the weights of {name} are under the "
                f"{self.licence.name}.",
                remedy="Read the licence, and set accept_licence to true if you accept it.",
            )
        if not self.licence.commercial:
            _warn_once(f"The weights of {name} are not for commercial use: {self.licence.name}.")

    def _missing(self, problem: str) -> MissingDependencyError:
        terms = "" if self.licence.permissive else f"accept the {self.licence.name} and "
        return MissingDependencyError(
            f"The weights '{self.weights}' of {type(self).__name__} {problem}.",
            remedy=f"Set weights to the folder that holds them, or {terms}run: "
            f"hf download {type(self)().weights}",
        )


def prepare_device(device: str) -> str:
    """Returns the torch device that runs a model; see `LearnedModel.device`.

    If it is the CPU, torch may use all cores but one, which is left to a control loop.
    """
    import torch

    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    if device == "cpu":
        torch.set_num_threads(max(1, len(os.sched_getaffinity(0)) - 1))
    return device


@cache
def _warn_once(text: str) -> None:
    logging.getLogger(__name__).warning(text)
