"""Joint trajectories for other tools, one format a file."""
