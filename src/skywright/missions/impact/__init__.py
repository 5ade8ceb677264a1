"""The mission kind `impact`."""
