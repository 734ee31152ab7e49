"""Parameters of the learned trackers. Importing this loads none of their libraries."""

from dataclasses import dataclass, field
from typing import ClassVar

from poil_drake.perception.positive_fields import check_positive


@dataclass(frozen=True, kw_only=True)
class ModelEnvironment:
    """Where a model runs. The three paths are needed.

    Class attributes: `name`, the model's name; `licence`, of its code and weights; `sources`, the
    addresses of its repository and of its weights.

    Attributes:
        python: The Python interpreter of an environment with the model's requirements.
        repository: A clone of the model's repository, which is the folder with `hubconf.py`.
        weights: The file of the model's weights.
        device: PyTorch's name of the device, e.g. cuda, cuda:1 or cpu. On a CPU, a frame takes
            seconds.
        load_timeout: Longest time until the model is loaded and has tracked once [s]. Reading the
            weights and compiling kernels may take a minute.
        timeout: Longest time for one frame [s]; a process that takes longer is killed, and the
            object counts as lost. A GPU needs about 0.2 s.
        support_points: Number of points, spread over the object, that are tracked beside the part's
            (POIL uses 40); in a scenario, `poil.num_support_points`.
    """

    name: ClassVar[str]
    licence: ClassVar[str]
    sources: ClassVar[tuple[str, str]]

    python: str = ""
    repository: str = ""
    weights: str = ""
    device: str = "cuda"
    load_timeout: float = 180.0
    timeout: float = 5.0
    support_points: int = field(default=40, metadata={"yaml": False})

    def __post_init__(self) -> None:
        check_positive(self, "load_timeout", "timeout")


@dataclass(frozen=True, kw_only=True)
class MvTrackerConfig(ModelEnvironment):
    """Parameters of MVTracker, besides those of a `ModelEnvironment`.

    Attributes:
        scene_scale: Factor from metres to the model's units [1/m]. The model was trained on scenes
            whose cameras are about 6 units away; 6 suits cameras at about 1 m.
        max_depth: Depth beyond which pixels are ignored [m].
        table_height: Height of the table [m, world], which becomes the model's ground plane, z = 0;
            in a scenario, `poil.table_height`.
    """

    name = "MVTracker"
    licence = "no licence file (code), Apache-2.0 (weights)"
    sources = (
        "https://github.com/ethz-vlg/mvtracker",
        "https://huggingface.co/ethz-vlg/mvtracker/resolve/main/mvtracker_200000_june2025.pth",
    )

    scene_scale: float = 6.0
    max_depth: float = 3.0
    table_height: float = field(default=0.0, metadata={"yaml": False})

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "scene_scale", "max_depth")


@dataclass(frozen=True, kw_only=True)
class CoTracker3Config(ModelEnvironment):
    """Parameters of CoTracker3: those of a `ModelEnvironment`."""

    name = "CoTracker3"
    licence = "CC BY-NC 4.0, which forbids commercial use"
    sources = (
        "https://github.com/facebookresearch/co-tracker",
        "https://huggingface.co/facebook/cotracker3/resolve/main/scaled_online.pth",
    )
