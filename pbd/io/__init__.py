"""Readers of files that others wrote: regular files only, bounded, with every failure as a PbdError."""
