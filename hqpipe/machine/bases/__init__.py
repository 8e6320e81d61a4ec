"""Base models: one file each, with the law that the effects bend."""
