"""Configures detection by name. Importing this loads no model. The classes' names are YAML tags."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from poil_drake.errors import InvalidValueError
from poil_drake.perception.learned_models.learned_model import LearnedModel, Licence
from poil_drake.perception.positive_fields import check_positive
from poil_drake.perception.segmenters.config import GrabCut, Sam2


@dataclass(frozen=True, kw_only=True)
class GroundingDino(LearnedModel):
    """Grounding DINO; its licence is permissive. See `LearnedModel` for the other fields.

    Attributes:
        threshold: Lowest score of a box, from 0 to 1.
    """

    weights: str = "IDEA-Research/grounding-dino-base"
    threshold: float = 0.25

    def __post_init__(self) -> None:
        _check_share(self, "threshold")


@dataclass(frozen=True, kw_only=True)
class RexOmni(LearnedModel):
    """Rex-Omni, which the paper uses; it needs a GPU with 12 GB. See `LearnedModel`."""

    licence: ClassVar[Licence] = Licence(
        name="IDEA License 1.0 and the Qwen Research License (research only)",
        permissive=False,
        commercial=False,
    )

    weights: str = "IDEA-Research/Rex-Omni"


@dataclass(frozen=True, kw_only=True)
class Sam3(LearnedModel):
    """SAM 3, whose weights Meta gives on request. See `LearnedModel` for the other fields.

    Attributes:
        threshold: Lowest score of a box, from 0 to 1.
    """

    licence: ClassVar[Licence] = Licence(name="SAM License", permissive=False, commercial=True)

    weights: str = "facebook/sam3"
    threshold: float = 0.3

    def __post_init__(self) -> None:
        _check_share(self, "threshold")


@dataclass(frozen=True, kw_only=True)
class OpenAiServer:
    """A vision-language model behind an OpenAI-compatible server, e.g. vLLM, SGLang or Ollama.

    Attributes:
        url: Address of the API, up to and including the version.
        model: The model's name on the server, e.g. "Qwen/Qwen2.5-VL-7B-Instruct".
        key_variable: Name of the environment variable that holds the API key; empty for no key.
        thousandths: Whether the model gives coordinates in thousandths of the image, as Qwen3-VL
            does, instead of pixels, as Qwen2.5-VL does.
        timeout: Longest silence of the server in one attempt, of which there are three [s].
    """

    url: str = "http://127.0.0.1:8000/v1"
    model: str = ""
    key_variable: str = ""
    thousandths: bool = False
    timeout: float = 30.0

    def __post_init__(self) -> None:
        if not self.url.startswith(("http://", "https://")):
            raise InvalidValueError(
                f"OpenAiServer.url is '{self.url}'.",
                remedy="Set an address that starts with http:// or https://.",
            )
        check_positive(self, "timeout")


@dataclass(frozen=True, kw_only=True)
class NamedDetectorConfig:
    """How objects and parts are found by their names.

    Attributes:
        finder: The model that finds boxes.
        segmenter: What turns boxes into masks.
        words: Name of an object or a part in the scenario -> the words that describe it to the
            model, e.g. {mug_7: white mug}. A name that is not listed describes itself.
        one_grid: Whether one query shows the model the crops of all views, as in the paper;
            otherwise there is a query for each view, which finds parts less often.
        timeout: Longest time of one detection in all views [s]; loading a model comes in addition.
    """

    finder: GroundingDino | RexOmni | Sam3 | OpenAiServer = field(default_factory=GroundingDino)
    segmenter: GrabCut | Sam2 = field(default_factory=GrabCut)
    words: Mapping[str, str] = field(default_factory=dict)
    one_grid: bool = True
    timeout: float = 120.0

    def __post_init__(self) -> None:
        check_positive(self, "timeout")


def _check_share(config: object, name: str) -> None:
    value = getattr(config, name)
    if not 0.0 <= value <= 1.0:
        raise InvalidValueError(
            f"{type(config).__name__}.{name} is {value}.", remedy="Set a number from 0 to 1."
        )
