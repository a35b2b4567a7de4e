"""Arms that lie in the plane under a camera, with a servo at every joint: what the tasks with one have alike."""
