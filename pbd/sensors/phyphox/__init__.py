"""A phone with the app phyphox as a sensor: its answers over HTTP, and the experiment that the app has to run."""
