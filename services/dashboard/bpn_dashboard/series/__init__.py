"""Metric series of runs: stored as chunks and rollups, read as few buckets with nothing lost from sight."""
