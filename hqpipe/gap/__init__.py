"""Where the simulator's model misses the recorded machine, and by how much."""
