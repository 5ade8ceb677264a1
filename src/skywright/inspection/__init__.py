"""From a probe's signal to inspection results: eddy current, weld line, contact quality."""
