"""The root `mission`."""
