"""All measurements of an asset in one file, over flights and years, and what they say together."""
