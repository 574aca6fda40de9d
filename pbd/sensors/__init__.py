"""Bytes to samples: one small file per wire protocol, the port, and a simulated hand."""
