"""How fast: every move from rest to rest within velocity, acceleration and jerk."""
