"""What every service does alike: start, lease, wait, ask, report, end."""
