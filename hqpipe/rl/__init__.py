"""Learning: observation, rewards, environment, policy, training, export. Torch is imported here and by the rival nets only."""

import os

# Spinning OpenMP threads take the cores from the simulator; torch reads this when it is first imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
