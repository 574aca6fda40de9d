"""Collision checks: bodies, allowed collisions, and motions checked continuously."""
