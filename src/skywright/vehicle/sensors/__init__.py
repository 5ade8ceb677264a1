"""Sensors: each reads the true state of the plant and fills a reading."""
