"""Configures segmenters. Importing this loads none. The classes' names are tags in YAML."""

from dataclasses import dataclass

from poil_drake.perception.learned_models.learned_model import LearnedModel


@dataclass(frozen=True, kw_only=True)
class GrabCut:
    """OpenCV's GrabCut, which needs no weights: colour, depth and the table tell the object."""


@dataclass(frozen=True, kw_only=True)
class Sam2(LearnedModel):
    """SAM 2.1, which needs transformers and weights. See `LearnedModel` for the fields.

    The default weights are the largest, 224 M parameters; "-tiny" in place of "-large" has 39 M.
    """

    weights: str = "facebook/sam2.1-hiera-large"
