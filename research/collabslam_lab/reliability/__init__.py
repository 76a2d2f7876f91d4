"""What the project promises of its reliability, measured: faults in the stream, fuzzing, endurance."""
