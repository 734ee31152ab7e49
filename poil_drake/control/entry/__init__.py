"""Safe entry: a collision-free way onto the reference from anywhere."""
