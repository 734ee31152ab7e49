"""Worker processes, threads, signals, real-time scheduling, timing, caches and output files."""
