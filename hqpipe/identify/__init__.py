"""The one fit, its intervals and its noise; the one criterion, the search over sets of effects, what changed."""
