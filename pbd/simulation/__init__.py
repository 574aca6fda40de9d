"""A hand with a sensor in it, simulated: motion, sensor errors, the truth, and a sensor on a pseudo-terminal."""
