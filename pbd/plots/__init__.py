"""Plots: their values (values, findings, compare) and the drawing (the others, with matplotlib)."""
