"""Neural rivals of the paper's model, trained on the same fit trials. Besides hqpipe.rl the only part that imports torch."""
