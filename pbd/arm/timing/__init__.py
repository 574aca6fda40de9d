"""Time the motion: every move goes from rest to rest within the velocity, acceleration and jerk limits."""
