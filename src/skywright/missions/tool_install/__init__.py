"""The mission kind `tool-install`."""
