"""From blocks to compiled loops: wiring by names of signals, and source for windows of logs, rows and batches of robots."""
