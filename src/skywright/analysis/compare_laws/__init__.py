"""`skywright compare laws`: control laws on the same flights, with paired statistics."""
