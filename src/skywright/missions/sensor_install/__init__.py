"""The mission kind `sensor-install`."""
