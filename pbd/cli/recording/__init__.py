"""What `pbd record` is made of: the device, the keys, the screen, the browser, a simulated hand."""
