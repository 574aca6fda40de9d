"""Parts of `pbd record`: the device, the keys, the screen, the browser, and the simulated hand."""
