"""What touches what: bodies, allowed collisions, a motion checked without gaps."""
