"""Exchange file formats: .nde, tables, JSON in a local frame, DICONDE-style results."""
