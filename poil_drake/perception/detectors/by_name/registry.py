"""Makes detectors that find objects and parts by their names."""

import os
from functools import partial

from poil_drake.perception.detectors.by_name.config import (
    GroundingDino,
    NamedDetectorConfig,
    OpenAiServer,
    RexOmni,
    Sam3,
)
from poil_drake.perception.detectors.by_name.detector import NamedDetector
from poil_drake.perception.detectors.by_name.grounding_dino import GroundingDinoFinder
from poil_drake.perception.detectors.by_name.open_ai_server import OpenAiServerFinder
from poil_drake.perception.detectors.by_name.protocol import BoxFinder
from poil_drake.perception.detectors.by_name.rex_omni import RexOmniFinder
from poil_drake.perception.detectors.by_name.sam3 import Sam3Finder
from poil_drake.perception.detectors.process_detector import ProcessDetector
from poil_drake.perception.learned_models.learned_model import LearnedModel
from poil_drake.perception.segmenters.config import GrabCut, Sam2
from poil_drake.perception.segmenters.grab_cut import GrabCutSegmenter
from poil_drake.perception.segmenters.protocol import Segmenter
from poil_drake.perception.segmenters.sam2 import Sam2Segmenter

_RUNNING: dict[str, ProcessDetector] = {}


def require_named_detector(config: NamedDetectorConfig) -> None:
    """Checks that a configuration is complete, and that what it names is on this machine.

    Raises:
        InvalidValueError: if a licence is not accepted, or a server's configuration is incomplete.
        MissingDependencyError: if a library or a model's weights are missing.
    """
    for part in (config.finder, config.segmenter):
        if isinstance(part, LearnedModel):
            part.check_licence()
            part.folder()
        elif isinstance(part, OpenAiServer):
            make_finder(part)


def make_named_detector(
    config: NamedDetectorConfig, *, table_height: float | None = None
) -> ProcessDetector:
    """Returns the detector of a configuration, which runs in a process of its own.

    All calls with equal arguments return the same detector, so that the demonstration, the target
    scene and a search for a lost object share one process and one copy of the weights.

    Args:
        config: The models, and the words for them.
        table_height: Height of the plane on which the objects stand [m, world]; None if unknown.

    Raises:
        InvalidValueError: see `require_named_detector`.
        MissingDependencyError: see `require_named_detector`.
    """
    require_named_detector(config)
    key = repr((config, table_height))
    if key not in _RUNNING:
        make = partial(build_detector, config, table_height)
        _RUNNING[key] = ProcessDetector(make, timeout=config.timeout)
    return _RUNNING[key]


def build_detector(config: NamedDetectorConfig, table_height: float | None) -> NamedDetector:
    """Loads the models in this process; see `make_named_detector`."""
    # Progress bars, and warnings that a checkpoint for video serves for images.
    os.environ |= {"HF_HUB_DISABLE_PROGRESS_BARS": "1", "TRANSFORMERS_VERBOSITY": "error"}
    return NamedDetector(
        make_finder(config.finder),
        make_segmenter(config.segmenter, table_height),
        words=config.words,
        one_grid=config.one_grid,
    )


def make_finder(config: GroundingDino | RexOmni | Sam3 | OpenAiServer) -> BoxFinder:
    """Returns the box finder of a configuration, whose model it loads."""
    match config:
        case GroundingDino():
            return GroundingDinoFinder(config)
        case RexOmni():
            return RexOmniFinder(config)
        case Sam3():
            return Sam3Finder(config)
        case OpenAiServer():
            return OpenAiServerFinder(config)


def make_segmenter(config: GrabCut | Sam2, table_height: float | None) -> Segmenter:
    """Returns the segmenter of a configuration, whose model it loads."""
    if isinstance(config, Sam2):
        return Sam2Segmenter(config)
    return GrabCutSegmenter(table_height)
