"""What compare does: its controllers, their training, their walks on the plant, and what these add up to."""
