"""Parts of `pbd record`: the device, the keys, the screen, the browser, a simulated hand."""
