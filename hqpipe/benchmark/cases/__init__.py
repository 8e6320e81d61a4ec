"""Withheld cases of servos, arms and cylinders: simulated machines that share no code with what is judged on their logs."""
