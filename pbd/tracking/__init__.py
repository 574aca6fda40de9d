"""Samples to a segmented hand path, one verb a file."""
