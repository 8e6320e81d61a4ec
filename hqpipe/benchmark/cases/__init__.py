"""Withheld cases: simulated servos, arms, cylinders and legged robots, which share no code with what is judged on their logs."""
