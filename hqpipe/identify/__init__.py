"""The one fit and the one criterion: parameters, least squares, evidence, search over sets of effects, what changed."""
