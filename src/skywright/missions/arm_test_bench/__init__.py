"""The mission kind `arm-test-bench`."""
