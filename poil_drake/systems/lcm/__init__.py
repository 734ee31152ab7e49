"""LCM: the drivers of the real Panda and its hand, simulated ones, networks and mailboxes."""
