"""What hqpipe asks of the operating system: processes, signals, durable writes, caches, and its failures in plain words."""
