"""What stages show: figures beside their results, and words at the terminal."""
