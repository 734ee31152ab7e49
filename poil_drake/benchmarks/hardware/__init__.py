"""The main job on the hardware path, and a stand-in robot."""
