"""What is said: causes, numbers, shares and a verdict, as diagnosis.json holds them."""
