"""Legged machines: robots, physics, what can be wrong with them, and what their loggers write."""
