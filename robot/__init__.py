"""Robots: one folder each with a URDF, robot.yaml and SOURCES.md."""
