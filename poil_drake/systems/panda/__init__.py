"""The simulated and the recorded Panda and its hand; `systems/lcm` connects the real ones."""
