"""The Panda and its hand, simulated or recorded; the real ones are in `systems/lcm`."""
