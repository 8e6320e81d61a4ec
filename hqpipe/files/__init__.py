"""Files that may hold anything: read as plain data or tensors, and checked field by field before use."""
