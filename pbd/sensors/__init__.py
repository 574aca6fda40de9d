"""Bytes to samples: one small file per wire protocol, registered in protocols.py, and the ports."""
