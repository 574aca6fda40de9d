"""Plots: their values (demo_values, findings, compare), and how matplotlib draws them (all other files)."""
