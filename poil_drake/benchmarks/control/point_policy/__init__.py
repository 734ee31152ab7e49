"""Point Policy (Haldar et al., 2025) on true points: behaviour cloning as a baseline.

Our own code, written from the paper's description. A transformer takes one token per point, made
of the point's recent positions, and predicts a chunk of its next positions. Overlapping chunks are
averaged, and a rigid fit of the current points to the average gives the twist. Only training
imports torch.

As published: absolute positions in past and future, normalised by the range of the data; the
lengths of history and chunk; the first observation repeated in place of those before it; the
squared error; the averaging of chunks; the rigid fit. So a policy goes where it was shown to go
from any start, and with one demonstration it knows only that trajectory in the world.

Not as published: the points are those of the object, which moves by itself (POIL, section IV-B),
not those of gripper and object; no gripper state; a smaller network without dropout, trained for
fewer steps (`PointPolicyConfig`); more samples at rest after a demonstration; and, unless set to
zero, noise on the observations in training.
"""
