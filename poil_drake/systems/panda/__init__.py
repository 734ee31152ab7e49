"""The simulated and the recorded Panda with its hand; `systems/lcm` connects the real robot."""
