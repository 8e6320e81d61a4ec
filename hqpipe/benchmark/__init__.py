"""Withheld cases: what makes them, and the score of a diagnosis on them."""
