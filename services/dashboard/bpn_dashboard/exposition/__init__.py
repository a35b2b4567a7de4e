"""What /metrics shows, as families of Prometheus: of runs, of workers, of the system around them."""
