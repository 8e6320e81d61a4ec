"""Figures and terminal tables of what the other packages found."""
