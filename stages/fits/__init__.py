"""What fit-actuator fits and how it judges it: the paper's model, its rivals, and the constants read out of it."""
