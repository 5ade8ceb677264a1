"""The mission kind `flight-modes`."""
