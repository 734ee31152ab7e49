"""Real cameras, each read on its own thread, and checks of what they deliver."""
