"""What stages are given: parameters and their bounds, the robot, logs, and the earlier record of a machine."""
