"""Localisation on simulated flights: data sets to try, and what the filters reach."""
