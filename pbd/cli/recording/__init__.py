"""Parts of `pbd record`: the device, the keys, the screen, the browser, the simulated hand, advice for takes."""
