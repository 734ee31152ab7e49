"""The point tracker and its stand-ins."""
