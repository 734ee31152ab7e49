"""Point Policy (Haldar et al., 2025) on ground-truth points: behaviour cloning as a rival.

Our own code, written from the paper's description. A transformer takes one token for each point,
made of the point's recent positions, and gives for each point a chunk of its next positions.
Overlapping chunks are averaged, and a rigid fit of the current points to the average gives the
twist. Nothing but training imports torch.

As published: positions are absolute, in the past and in the future, and normalised by the range of
the data; lengths of history and chunk; what stands for observations before the first one; the
squared error; the averaging of chunks; the rigid fit. So a policy goes to where it was shown to go,
wherever it starts, and with one demonstration it knows that one trajectory in the world.

Not as published: the points are the object's, which moves by itself (POIL, section IV-B), not the
gripper's and the object's; no gripper state; the smaller network without dropout and its shorter
training (`PointPolicyConfig`); more samples at rest behind a demonstration; and, unless it is set
to zero, the noise on what is observed in training.
"""
