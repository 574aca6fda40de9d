"""Opening and writing files: others' are regular and bounded, each failure is a PbdError; ours are written whole."""
