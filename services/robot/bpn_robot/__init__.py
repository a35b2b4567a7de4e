"""A robot with its camera behind the bus: the service, and what a robot is to it. No simulation."""
