"""Worker processes: isolation, scheduling, output, interrupts and the oracle channel."""
