"""Hydraulic cylinders commanded in force: their loop, what can be wrong with them, and what their loggers write."""
