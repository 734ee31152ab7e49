"""Trials of `poil run` through the interface of the real robot, and a stand-in robot."""
