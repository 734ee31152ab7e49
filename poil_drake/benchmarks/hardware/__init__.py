"""The main job through the interface of the real robot, and a stand-in robot."""
