"""The smoother's model as a live filter: one sample at a time, while the hand moves."""
