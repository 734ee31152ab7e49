"""Point Policy (Haldar et al., 2025) on ground-truth points: behaviour cloning as a rival.

Our own code, written from the paper's description. A transformer takes one token for each point,
made of the point's recent positions, and gives for each point a chunk of its next positions.
Overlapping chunks are averaged, and a rigid fit of the current points to the average gives the
twist. Nothing but training imports torch.
"""
