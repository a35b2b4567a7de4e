"""REST under /api/v1, health, metrics, and the web UI's files."""
