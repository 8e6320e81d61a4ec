"""The fit of the paper's four coefficients, and what it returns."""
