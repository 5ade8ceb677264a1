"""One execution of a mission: planning, flight, evaluation and its directory."""
