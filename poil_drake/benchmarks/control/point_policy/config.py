"""The settings of Point Policy, all of which its weights depend on."""

from dataclasses import dataclass

from poil_drake.errors import InvalidValueError


@dataclass(frozen=True, kw_only=True)
class PointPolicyConfig:
    """How the network is built, trained and executed.

    Attributes:
        period: Time between two samples of a demonstration, and between two steps of the policy
            [s]. 1/16 s is exact in binary and lets a chunk reach 1.25 s ahead.
        history: Observations that the network sees, the current one included; as published.
        chunk: Future positions that it predicts; as published.
        aggregation_rate: m of the weights exp(-m i) of overlapping chunks, i = 0 for the oldest
            (Zhao et al., RSS 2023); as published.
        width: D, length of a token. 256 is published, on a GPU; 64 trains in under a minute on
            one core.
        layers: Transformer layers; 4 are published.
        heads: Attention heads.
        steps: Optimisation steps; 100,000 are published. After 5,000, the points come to rest
            within 1 mm of a demonstrated goal unless something is in their way.
        batch: Windows in a step; 64 are published, half of it takes half the time.
        learning_rate: At its highest; it falls to zero along half a cosine. 1e-4 is published, for
            twenty times as many steps.
        warm_up: Part of the steps in which the learning rate rises linearly.
        translation_noise: Standard deviation of the shift of the observations in a window, along
            each axis [m]; see `perturb_histories`. Not published; zero is.
        rotation_noise: Standard deviation of their turn about each axis [rad]. 0.05 rad moves a
            point 10 cm from the centroid by 5 mm. Not published; zero is.
        halt_probability: Part of the windows in training whose points seem to have stood still, as
            after a contact. Not published, zero is: it helps a policy that was held up to go on.
        rest: Samples at rest appended to each demonstration, so that the policy learns to stay
            at the goal. More than the `history` that is published, so that it also learns to stay
            once it has stayed.
        threads: Of torch, in training. More than one does not pay for so small a network.
        seed: Of the first weights, the batches and the noise.
    """

    period: float = 1.0 / 16.0
    history: int = 10
    chunk: int = 20
    aggregation_rate: float = 0.01
    width: int = 64
    layers: int = 2
    heads: int = 4
    steps: int = 5_000
    batch: int = 32
    learning_rate: float = 2e-3
    warm_up: float = 0.05
    translation_noise: float = 0.005
    rotation_noise: float = 0.05
    halt_probability: float = 0.1
    rest: int = 24
    threads: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        counts = ("history", "chunk", "width", "layers", "heads", "steps", "batch", "threads")
        for name in counts:
            if getattr(self, name) < 1:
                raise InvalidValueError(
                    f"PointPolicyConfig.{name} is {getattr(self, name)}.",
                    remedy="Pass 1 or more.",
                )
        if not (self.period > 0.0 and self.learning_rate > 0.0):
            raise InvalidValueError(
                f"PointPolicyConfig has period={self.period} and "
                f"learning_rate={self.learning_rate}.",
                remedy="Both must be positive.",
            )
        not_negative = ("aggregation_rate", "translation_noise", "rotation_noise", "rest")
        for name in not_negative:
            if not getattr(self, name) >= 0:
                raise InvalidValueError(
                    f"PointPolicyConfig.{name} is {getattr(self, name)}.",
                    remedy="Pass 0 or more.",
                )
        if not (0.0 <= self.warm_up < 1.0 and 0.0 <= self.halt_probability <= 1.0):
            raise InvalidValueError(
                f"PointPolicyConfig has warm_up={self.warm_up} and "
                f"halt_probability={self.halt_probability}.",
                remedy="Both are parts of a whole, from 0 to 1; not all steps can be warm-up.",
            )
        if self.width % self.heads:
            raise InvalidValueError(
                f"PointPolicyConfig has tokens of length {self.width} for {self.heads} heads.",
                remedy="Pass a width that the number of heads divides.",
            )
