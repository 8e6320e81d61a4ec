"""Whether logs are sound, and what is left out of those that are not; before a cause is sought."""
