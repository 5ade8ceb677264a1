"""Control laws of the platform and a rigid arm: a module each, with one class."""
