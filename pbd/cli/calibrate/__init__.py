"""pbd calibrate dock / points / mount / sensor / show: makes calibration/NAME.toml, step by step."""
