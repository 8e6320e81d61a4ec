"""Identification: free-running residuals, fits with intervals, and comparisons on held-out trials."""
