"""The settings of Point Policy. The trained weights depend on all of them."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PointPolicyConfig:
    """How the network is built, trained and executed.

    Attributes:
        period: Time between two samples of a demonstration, and between two steps of the policy
            [s]. 1/16 s is exact in binary and makes a chunk reach 1.25 s ahead.
        history: Number of observations the network sees, with the current one; as in the paper.
        chunk: Number of future positions predicted for each point; as in the paper.
        aggregation_rate: m in the weights exp(-m i) of overlapping chunks, where i = 0 is the
            oldest chunk (Zhao et al., RSS 2023); as in the paper.
        width: Length of a token. The paper uses 256, on a GPU; 64 trains in under a minute on one
            core.
        layers: Number of transformer layers; the paper uses 4.
        heads: Number of attention heads; divides `width`.
        steps: Number of optimisation steps; the paper uses 100,000. After 5,000, the points come to
            rest within 1 mm of a demonstrated goal unless something blocks them.
        batch: Windows per step. The paper uses 64; 32 take half the time.
        learning_rate: Peak learning rate, which decays to zero along half a cosine. The paper uses
            1e-4, for twenty times as many steps.
        warm_up: Share of the steps in which the learning rate rises linearly.
        translation_noise: Standard deviation of the shift of the observations in a window, along
            each axis [m]; see `perturb_histories`. The published method has none.
        rotation_noise: Standard deviation of the window's rotation about each axis [rad]. 0.05 rad
            moves a point 10 cm from the centroid by 5 mm. The published method has none.
        halt_probability: Share of the training windows whose points seem to have stopped, as
            after a contact, so that a blocked policy learns to continue. The published method has
            none.
        rest: Number of samples at rest appended to each demonstration, so that the policy learns to
            stay at the goal. The paper appends `history` samples; with more, the policy also learns
            to stay once its whole history is at rest.
        seed: Seed of the initial weights, the batches and the noise.
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
    seed: int = 0
