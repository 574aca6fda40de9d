"""pbd calibrate: each step (dock, points, mount, sensor, show) is a file here."""
