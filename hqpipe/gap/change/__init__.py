"""What an earlier record of the same machine says: its logs, or the actuator model that was fitted to them."""
