"""Withheld-effect cases: how they are written, diagnosed and scored, and the commands for both."""
