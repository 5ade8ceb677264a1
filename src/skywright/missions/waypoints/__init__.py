"""The mission kind `waypoints`."""
