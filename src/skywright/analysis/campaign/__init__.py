"""Campaigns: many runs of one mission with varied conditions (Monte Carlo)."""
