"""Plots: what they show (values, findings, compare) and how it is drawn (the others, with matplotlib)."""
