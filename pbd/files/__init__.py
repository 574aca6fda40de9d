"""Files: demonstrations, robots, calibrations, importers, exporters. The only disk I/O."""
