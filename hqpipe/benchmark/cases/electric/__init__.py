"""Servos and arms: what moves them, what can be wrong with them, and what their loggers write."""
