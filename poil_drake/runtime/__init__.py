"""Worker processes, threads, signals, real-time scheduling, stopwatch, and whole files."""
