"""The mission kind `excitation`."""
