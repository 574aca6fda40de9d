"""A phone with the app phyphox: its answers over HTTP, and the experiment that it needs."""
