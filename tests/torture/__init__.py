"""Torture: what a workstation does to a run – kills, damage, full disks, little memory, two writers, odd files.

``python -m tests.torture --seed S --minutes M`` runs it; docs/reliability.md says what it shows.
"""
