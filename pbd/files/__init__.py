"""Files: demonstrations, robots, calibrations, importers, exporters."""
