"""Imports the recordings of ROS as demonstrations."""
