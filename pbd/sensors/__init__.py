"""Bytes to samples: one small file per wire protocol, and the ports."""
