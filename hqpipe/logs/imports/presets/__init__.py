"""Layouts of known projects: what their files hold, and the mapping that makes a log set of them."""
