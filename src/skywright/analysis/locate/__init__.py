"""Localisation: estimates from recorded or simulated data, and the accuracy of the filters."""
