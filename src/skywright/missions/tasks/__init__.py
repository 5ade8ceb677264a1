"""Tables `mission.task`, one module a kind of mission; only specs, so that files load fast."""
