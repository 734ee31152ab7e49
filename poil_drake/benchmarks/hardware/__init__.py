"""The main job through the real robot's interface, and a stand-in robot."""
