"""LCM: connections to the drivers of the Panda and its hand, and simulated drivers."""
