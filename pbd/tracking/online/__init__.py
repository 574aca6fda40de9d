"""The same model while the hand moves: one sample at a time."""
