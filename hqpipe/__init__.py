"""hqpipe: close the sim-to-real gap of heavy hydraulic legged robots."""

__version__ = "0.1.0"
