"""Physical quantities read out of fitted coefficients, and what the robot's design says of them."""
