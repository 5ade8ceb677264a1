"""The mission kind `scan`."""
