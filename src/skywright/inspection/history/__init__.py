"""Database of all measurements of an asset, over flights and years, and their evaluation."""
