"""Mission code that several kinds share."""
