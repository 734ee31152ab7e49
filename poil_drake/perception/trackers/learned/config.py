"""Parameters of the learned trackers. Importing this loads none of their libraries."""

from dataclasses import dataclass, field
from typing import ClassVar

from poil_drake.perception.learned_models.learned_model import LearnedModel, Licence
from poil_drake.perception.positive_fields import check_positive


@dataclass(frozen=True, kw_only=True)
class ModelEnvironment(LearnedModel):
    """A model that runs in another Python environment. See `LearnedModel` for the other fields.

    Here, `weights` is a file, and python, repository and weights are needed.

    Class attributes: `name`, the model's name; `repository_url` and `weights_url`, where its code
    and its weights are.

    Attributes:
        python: The Python interpreter of an environment with the model's requirements.
        repository: A clone of the model's repository, which is the folder with `hubconf.py`.
        load_timeout: Longest time until the model is loaded and has tracked once [s]. Reading the
            weights and compiling kernels may take a minute.
        timeout: Longest time for one frame [s]; a process that takes longer is killed, and the
            object counts as lost. A GPU needs about 0.2 s, a CPU many seconds.
        support_points: Number of points, spread over the object, that are tracked beside the part's
            (POIL uses 40); in a scenario, `poil.num_support_points`.
    """

    name: ClassVar[str]
    repository_url: ClassVar[str]
    weights_url: ClassVar[str]

    python: str = ""
    repository: str = ""
    load_timeout: float = 180.0
    timeout: float = 5.0
    support_points: int = field(default=40, metadata={"yaml": False})

    def __post_init__(self) -> None:
        check_positive(self, "load_timeout", "timeout")


@dataclass(frozen=True, kw_only=True)
class MvTrackerConfig(ModelEnvironment):
    """MVTracker; its code states no licence. See `ModelEnvironment` for the other fields.

    Attributes:
        scene_scale: Factor from metres to the model's units [1/m]. The model was trained on scenes
            whose cameras are about 6 units away; 6 suits cameras at about 1 m.
        max_depth: Depth beyond which pixels are ignored [m].
        table_height: Height of the table [m, world], which becomes the model's ground plane, z = 0;
            in a scenario, `poil.table_height`.
    """

    name = "MVTracker"
    repository_url = "https://github.com/ethz-vlg/mvtracker"
    weights_url = (
        "https://huggingface.co/ethz-vlg/mvtracker/resolve/main/mvtracker_200000_june2025.pth"
    )

    scene_scale: float = 6.0
    max_depth: float = 3.0
    table_height: float = field(default=0.0, metadata={"yaml": False})

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(self, "scene_scale", "max_depth")


@dataclass(frozen=True, kw_only=True)
class CoTracker3Config(ModelEnvironment):
    """CoTracker3's online model. See `ModelEnvironment` for the fields."""

    licence: ClassVar[Licence] = Licence(name="CC BY-NC 4.0", permissive=True, commercial=False)
    name = "CoTracker3"
    repository_url = "https://github.com/facebookresearch/co-tracker"
    weights_url = "https://huggingface.co/facebook/cotracker3/resolve/main/scaled_online.pth"
