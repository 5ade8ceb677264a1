"""Two runs laid over each other: `skywright compare runs A B`."""
