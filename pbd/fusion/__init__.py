"""Several takes of one task made one demonstration: aligned, estimated together, with the hand's scatter."""
