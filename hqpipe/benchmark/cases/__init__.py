"""Withheld cases: simulated servos, arms, cylinders and legged robots that share no code with what is judged on their logs."""
