"""The mission kind `bar-transport`."""
