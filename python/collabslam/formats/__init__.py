"""Files that a run leaves behind: trajectories and maps in the formats that other tools read."""
