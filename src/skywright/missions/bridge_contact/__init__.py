"""The mission kind `bridge-contact`."""
