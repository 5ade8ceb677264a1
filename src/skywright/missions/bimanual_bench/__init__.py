"""The mission kind `bimanual-bench`."""
