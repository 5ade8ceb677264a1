"""Laws of arms with position servos; a module is a kind."""
