"""Settings of tests that are not about the map: structures stand where their world has them."""

EXACT = ("plant.map_error_m=0", "plant.map_error_deg=0", "plant.map_error_size_m=0")
KNOWN = {"plant.map_error_m": 0.0, "plant.map_error_deg": 0.0, "plant.map_error_size_m": 0.0}
"""The same as a mapping."""
