"""Hydraulic cylinders commanded at the valve: their physics, what can be wrong with them, and what their loggers write."""
