"""What a run is: task, network, algorithm, configuration, and its random numbers; pure data."""
