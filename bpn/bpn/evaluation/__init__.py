"""Playing a trained policy: real processes over the bus, and what their episodes show."""
