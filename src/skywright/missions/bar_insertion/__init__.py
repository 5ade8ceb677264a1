"""The mission kind `bar-insertion`."""
