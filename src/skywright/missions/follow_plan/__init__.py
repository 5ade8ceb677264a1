"""The mission kind `follow-plan`."""
