"""Compute inspection results from probe signals: eddy current, weld line, contact quality."""
