"""Sensors: each sees the truth of the plant and fills a reading."""
