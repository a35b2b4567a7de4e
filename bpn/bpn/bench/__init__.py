"""Side-by-side measurements, run by `bpn bench`."""
