"""Tool poses to a joint trajectory that the arm may run."""
