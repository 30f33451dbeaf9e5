"""One episode as a self-contained MCAP file: written, read, and cut into clips."""
