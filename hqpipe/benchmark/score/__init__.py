"""The score of a diagnosis on cases whose effects were withheld."""
