"""Fuse several takes of one task: match their keyframes, estimate them jointly, learn the hand's scatter."""
