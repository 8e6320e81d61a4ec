"""What a layer's models leave of the recorded output: by block, joint and regime, with intervals."""
