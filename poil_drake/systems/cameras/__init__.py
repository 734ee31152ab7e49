"""Camera systems: delayed, captured, recorded and over LCM."""
