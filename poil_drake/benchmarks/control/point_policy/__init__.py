"""Point Policy (Haldar et al., 2025) on true points: behaviour cloning as a baseline.

This is an independent implementation of the paper's description. A transformer takes one token per
point, made of the point's recent positions, and predicts a chunk of its next positions. Overlapping
chunks are averaged, and a rigid fit of the current points to the average gives the twist. Only
training imports torch.

As published: absolute past and future positions, normalised by the range of the data; the lengths
of history and chunk; a history that is filled with the first observation; the squared error; the
averaging of chunks; the rigid fit. A policy therefore heads for the demonstrated positions from any
start. With one demonstration, it knows only that one trajectory in the world.

Not as published: the points are those of the object alone, since it moves without a gripper (POIL,
section IV-B); there is no gripper state; the network is smaller, has no dropout, and is trained for
fewer steps (`PointPolicyConfig`); more samples at rest follow a demonstration; and the observations
are noisy in training, unless the noise is set to zero.
"""
