"""Logs as machines write them made usable: missing samples, jitter, gaps, several rates."""
