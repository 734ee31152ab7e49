"""The Panda's interface: simulated, recorded and over LCM."""
