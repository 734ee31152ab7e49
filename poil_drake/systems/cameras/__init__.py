"""Camera systems for simulation, hardware, replay and LCM."""
