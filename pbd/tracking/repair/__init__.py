"""What a sensor gets wrong before it is tracked: mended with a warning, or refused."""
