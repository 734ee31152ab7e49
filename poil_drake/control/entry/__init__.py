"""Safe entry: a collision-free path onto the reference from anywhere."""
