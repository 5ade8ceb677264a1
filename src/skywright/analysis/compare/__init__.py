"""`skywright compare`: two robots side by side."""
