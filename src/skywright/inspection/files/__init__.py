"""Files of others: .nde, tables, JSON in a local frame, DICONDE-style results."""
